"""Routes of workspaces: list, make, overview, coverage, lists of what they contain, files."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import Request
from starlette.responses import Response

from fusion.pipeline.catalog import CATALOG_FILE
from fusion.service.api.access import ADMIN, KNOWN, READ, Routes, caller_of
from fusion.service.api.answers import json_answer
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.files import file_answer
from fusion.service.api.pages import After, Limit, next_link, page_of
from fusion.service.api.routes.jobs import submitted
from fusion.service.api.schemas import results, surfaces, work
from fusion.service.api.service import opened_for, service_of
from fusion.service.jobs import JobKind
from fusion.service.state import WORKSPACE_NAME
from fusion.service.store import Scope
from fusion.service.views import ListKind, coverage, list_page, overview
from fusion.service.views.outlines import outlines
from fusion.service.views.surfaces import SurfaceKind

routes = Routes("/api/v1/workspaces", "workspaces")

# They name where files lie on the machine; the routes of runs and provenance give what is in them.
_NOTES = {"provenance", CATALOG_FILE, f"{CATALOG_FILE}-wal", f"{CATALOG_FILE}-shm"}

Solution = Annotated[str, Query(max_length=100, description="By default the one in use.")]


class WorkspaceRequest(BaseModel):
    """A workspace that is to be made, empty or from uploads to its name."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"name": "bennu", "body": "Bennu"}]}
    )

    name: str = Field(pattern=f"^{WORKSPACE_NAME}$")
    body: str = Field(default="body", min_length=1, max_length=100)


@routes.add("GET", "", KNOWN, results.WORKSPACES)
def workspaces(request: Request, after: After = "", limit: Limit = 100) -> Response:
    """List the workspaces that may be read."""
    caller = caller_of(request)
    names = [name for name in service_of(request).names() if caller.may(Scope.READ, name)]
    shown, more = page_of(request, names, after, limit)
    return json_answer(request, {"workspaces": [{"name": name} for name in shown]}, more)


@routes.add("POST", "", ADMIN, work.JOB, status_code=202)
def make_workspace(request: Request, body: WorkspaceRequest) -> Response:
    """Make a workspace, by a job. With a shape or SPC files: upload them, and submit `init`."""
    service = service_of(request)
    if service.is_single:
        what, do = "the service has one workspace only", "serve the folder above it"
        raise RequestRefusedError(Refusal.CONFLICT, what, body.name, do)
    if body.name in service.names():
        raise RequestRefusedError(Refusal.CONFLICT, "exists already", body.name)
    return submitted(request, body.name, JobKind.INIT, {"body": body.body}, {})


@routes.add("GET", "/{workspace}", READ, results.Overview)
def workspace_overview(request: Request, workspace: str, solution: Solution = "") -> Response:
    """Return counts, stages and their state, main results, and problems of a workspace."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, overview(opened))


@routes.add("GET", "/{workspace}/coverage", READ, surfaces.Coverage)
def workspace_coverage(
    request: Request,
    workspace: str,
    step_deg: Annotated[float, Query(ge=0.25, le=90.0)] = 5.0,
    solution: Solution = "",
) -> Response:
    """Return where maplets, mapolas, bigmaps, images and returns lie on the body."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, coverage(opened, step_deg=step_deg))


@routes.add("GET", "/{workspace}/outlines", READ, surfaces.Outlines)
def workspace_outlines(
    request: Request, workspace: str, kind: SurfaceKind, solution: Solution = ""
) -> Response:
    """Return the squares that maplets, mapolas, fused maplets or bigmaps cover on the body."""
    with opened_for(request, workspace, solution) as opened:
        return json_answer(request, outlines(opened, kind, cache=service_of(request).cache))


@routes.add("GET", "/{workspace}/files/{path:path}", READ, results.FILE)
def workspace_file(request: Request, workspace: str, path: str) -> Response:
    """Return a file of a workspace, or a range of its bytes.

    Links, hidden files, and what the program notes for itself are none.
    """
    if path.partition("/")[0] in _NOTES:
        raise RequestRefusedError(Refusal.NOT_FOUND, "there is no such file", path)
    return file_answer(request, service_of(request).folder(workspace), path)


def _add_list(kind: ListKind) -> None:
    """Add the route of one list."""

    def listed(
        request: Request,
        workspace: str,
        after: After = "",
        limit: Limit = 100,
        solution: Solution = "",
    ) -> Response:
        with opened_for(request, workspace, solution) as opened:
            page = list_page(opened, kind, after=after, limit=limit)
        more: dict[str, Any] = next_link(request, "after", page.next) if page.next else {}
        return json_answer(request, {kind.value: page.items, "total": page.total}, more)

    about = f"List the {kind.value} of a workspace."
    path, answer = f"/{{workspace}}/{kind.value}", results.LISTS[kind.value]
    routes.add("GET", path, READ, answer, name=kind.value, description=about)(listed)


for _kind in ListKind:
    _add_list(_kind)
