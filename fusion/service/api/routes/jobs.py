"""Routes of jobs: submit, list, watch, cancel, log, and events as they happen."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import Header, Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from fusion.service.api.access import KNOWN, READ, READ_JOB, RUN, RUN_JOB, Routes, caller_of
from fusion.service.api.answers import described, json_answer
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.events import stream
from fusion.service.api.pages import After, Limit, next_link, page_of
from fusion.service.api.parameters import check_parameters
from fusion.service.api.schemas import work
from fusion.service.api.service import Service, service_of
from fusion.service.commands.json_options import writes_outputs
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import JobKind, JobRequest, JobState
from fusion.service.store import Scope, UnknownJobError
from fusion.service.work.parameters import EXAMPLES, PARAMETERS
from fusion.service.work.places import output_files

routes = Routes("/api/v1", "jobs")
_MOST_EVENTS = 1000

Before = Annotated[str, Query(max_length=64, description="Last job of the page before.")]
States = Annotated[list[JobState], Query(description="Only jobs in these states.")]
Key = Annotated[
    str,
    Header(
        alias="Idempotency-Key",
        max_length=128,
        description="The same key again gives the first job, not a second one.",
    ),
]


class JobSubmission(BaseModel):
    """A job as it is submitted: a kind, what it takes, and when it may begin."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"kind": kind.value, "parameters": dict(given)} for kind, given in EXAMPLES.items()
            ]
        },
    )

    kind: JobKind = JobKind.RUN
    parameters: dict[str, Any] = Field(default_factory=dict, description="What the kind takes.")
    priority: int = Field(default=0, ge=-100, le=100)
    after: list[Annotated[str, Field(max_length=64)]] = Field(default_factory=list, max_length=100)


class ForecastRequest(BaseModel):
    """A run whose time, memory and disk are to be known before it is submitted."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"parameters": {"stages": ["fuse"]}}]}
    )

    parameters: dict[str, Any] = Field(default_factory=dict, description="As of a run.")


@routes.add("GET", "/job-kinds", KNOWN, work.KINDS)
def kinds(request: Request, after: After = "", limit: Limit = 100) -> Response:
    """List the kinds of jobs: the command that does the same, JSON schema and example."""
    shown, more = page_of(request, [kind.value for kind in JobKind], after, limit)
    found = [
        {
            "kind": kind,
            "command": COMMANDS[kind].name if kind in COMMANDS else _OTHERS[kind],
            "parameters": PARAMETERS[kind].model_json_schema(),
            "example": EXAMPLES[kind],
        }
        for kind in map(JobKind, shown)
    ]
    return described(request, {"kinds": found}, more)


_OTHERS = {
    JobKind.RUN: "run",
    JobKind.FORECAST: "run --forecast",
    JobKind.SCALE_APPLY: "scale --apply",
    JobKind.INIT: "init",
}


@routes.add("POST", "/workspaces/{workspace}/jobs", RUN, work.JOB, status_code=202)
def submit(request: Request, workspace: str, body: JobSubmission, key: Key = "") -> Response:
    """Submit a job; the answer names it before it begins."""
    _check_before(request, body.after)
    asked = {"priority": body.priority, "after": tuple(body.after), "key": key}
    return submitted(request, workspace, body.kind, body.parameters, asked)


@routes.add("POST", "/workspaces/{workspace}/forecast", RUN, work.JOB, status_code=202)
def forecast(request: Request, workspace: str, body: ForecastRequest) -> Response:
    """Have time, memory and disk of a run forecast; the result of the job has them."""
    # Somebody waits for it in order to submit the run.
    return submitted(request, workspace, JobKind.FORECAST, body.parameters, {"priority": 100})


@routes.add("GET", "/workspaces/{workspace}/jobs", READ, work.JOBS)
def workspace_jobs(
    request: Request,
    workspace: str,
    state: States = [],  # noqa: B006  FastAPI copies it
    before: Before = "",
    limit: Limit = 100,
) -> Response:
    """List the jobs of a workspace, the newest first."""
    service_of(request).folder(workspace)
    return _listed(request, [workspace], state, before, limit)


@routes.add("GET", "/jobs", KNOWN, work.JOBS)
def all_jobs(
    request: Request,
    state: States = [],  # noqa: B006
    before: Before = "",
    limit: Limit = 100,
) -> Response:
    """List the jobs of all workspaces that may be read, the newest first."""
    return _listed(request, _readable(request), state, before, limit)


@routes.add("GET", "/jobs/{job}", READ_JOB, work.JOB)
def job(request: Request, job: str) -> Response:
    """Return a job with its progress, and its result or error."""
    return json_answer(request, service_of(request).store.job(job).as_json())


@routes.add("POST", "/jobs/{job}/cancel", RUN_JOB, work.JOB)
def cancel(request: Request, job: str) -> Response:
    """Cancel a job: at once while it waits; one that runs ends with its current items."""
    return json_answer(request, service_of(request).store.cancel(job).as_json())


@routes.add("GET", "/jobs/{job}/log", READ_JOB, work.LINES)
def log(
    request: Request,
    job: str,
    after: Annotated[int, Query(ge=0, le=2**62)] = 0,
    limit: Limit = 1000,
) -> Response:
    """Return the lines of a job's log, the oldest first."""
    store = service_of(request).store
    lines: list[dict[str, Any]] = []
    while len(lines) < limit:
        found = store.events(after, job=job, limit=_MOST_EVENTS)
        for event in found:
            after = event.number
            if event.kind == "note":
                lines.append({"number": after, "time": event.time, **dict(event.content)})
            if len(lines) == limit:
                break
        if len(found) < _MOST_EVENTS:
            break
    more = next_link(request, "after", str(after)) if len(lines) == limit else {}
    return json_answer(request, {"lines": lines}, more)


@routes.add(
    "GET",
    "/events",
    KNOWN,
    work.EVENTS,
    tagged=False,
    response_class=StreamingResponse,
)
async def events(
    request: Request,
    job: Annotated[str, Query(max_length=64)] = "",
    workspace: Annotated[str, Query(max_length=64)] = "",
    last: Annotated[str, Header(alias="Last-Event-ID", max_length=20)] = "",
) -> Response:
    """Stream events of jobs as they happen; with Last-Event-ID from the one after it.

    Without it: of one job all of its events, of several those from now on.
    """
    service = service_of(request)
    workspaces = _readable(request, workspace)
    if job:
        await READ_JOB.check_job(request, job)
    if last and not (last.isascii() and last.isdecimal()):
        raise RequestRefusedError(Refusal.INVALID, "is no number of an event", "Last-Event-ID")
    if service.streams >= service.limits.streams:
        raise RequestRefusedError(
            Refusal.TOO_MANY, "too many streams are open", do="close some", retry_after_s=5.0
        )
    after = int(last) if last else 0 if job else service.feed.last
    texts = stream(
        service.feed,
        after,
        job=job,
        workspaces=workspaces,
        heartbeat_s=service.limits.heartbeat_s,
    )

    async def counted() -> AsyncIterator[str]:
        with service.streaming():
            async for text in texts:
                yield text

    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(counted(), media_type="text/event-stream", headers=headers)


def submitted(
    request: Request,
    workspace: str,
    kind: JobKind,
    parameters: dict[str, Any],
    asked: dict[str, Any],
) -> Response:
    """Submit a job of a kind, checked before; `asked` are further fields of its request."""
    service = service_of(request)
    before = asked.get("after", ())
    follows = any(service.store.job(one).request.workspace == workspace for one in before)
    uploads = service.store.uploads
    check_parameters(service, uploads, workspace, kind, parameters, follows=follows)
    _check_outputs(service, workspace, kind)
    user = caller_of(request).name
    job = service.store.submit(JobRequest(kind, workspace, user, parameters, **asked))
    answer = json_answer(request, job.as_json(), {"Location": f"/api/v1/jobs/{job.id}"})
    answer.status_code = 202
    return answer


def _check_outputs(service: Service, workspace: str, kind: JobKind) -> None:
    """Refuse a job that writes outputs where there are too many already."""
    if kind in COMMANDS and writes_outputs(COMMANDS[kind].options):
        there = sum(output_files(service.root, workspace).values())
        if there >= service.limits.outputs_bytes:
            what = f"outputs of {there} bytes are there already"
            raise RequestRefusedError(
                Refusal.OVER_QUOTA, what, workspace, "download and remove some"
            )


def _check_before(request: Request, jobs: list[str]) -> None:
    """Refuse jobs to wait for that may not be read; the answer does not say whether they are."""
    caller, store = caller_of(request), service_of(request).store
    for identity in jobs:
        if not caller.may(Scope.READ, store.job(identity).request.workspace):
            raise UnknownJobError(identity)


def _readable(request: Request, workspace: str = "") -> list[str] | None:
    """Return the workspaces whose jobs may be read: `workspace` alone, or None for all."""
    caller = caller_of(request)
    if workspace:
        if not caller.may(Scope.READ, workspace):
            raise RequestRefusedError(Refusal.FORBIDDEN, "may not be read", "workspace")
        return [workspace]
    return None if caller.may(Scope.READ) else sorted(caller.token.scopes)


def _listed(
    request: Request,
    workspaces: list[str] | None,
    states: list[JobState],
    before: str,
    limit: int,
) -> Response:
    found = service_of(request).store.jobs(
        workspaces=workspaces, states=states or None, before=before, limit=limit + 1
    )
    shown = found[:limit]
    more = next_link(request, "before", shown[-1].id) if len(found) > limit else {}
    return json_answer(request, {"jobs": [one.as_json() for one in shown]}, more)
