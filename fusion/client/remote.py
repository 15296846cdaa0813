"""A server of ``spcola serve`` as a place of workspaces."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import Formatter
from typing import Any
from urllib.parse import parse_qsl, quote, urlsplit

from fusion.client.asking import Asking
from fusion.client.place import FilePart, View
from fusion.client.steps import (
    Answer,
    Emit,
    Emitting,
    LostConnectionError,
    NextLine,
    Pause,
    Request,
    Send,
    Steps,
)
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.jobs import Event, Job, JobRequest, JobState

_API = "/api/v1"
_PAGE = 1000
_AGAIN_S = 0.5
_PARTIAL = 206
_PART_TYPE = "application/offset+octet-stream"


@dataclass(frozen=True)
class Remote:
    """The workspaces of a server."""

    asking: Asking

    @property
    def name(self) -> str:
        """Address of the server."""
        return self.asking.url

    def workspaces(self) -> Steps[list[str]]:
        """Return the names of the workspaces that may be read."""
        found = yield from self._all(Request("GET", f"{_API}/workspaces", {"limit": _PAGE}))
        return [each["name"] for each in found["workspaces"]]

    def view(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Return JSON: a view, of lists all pages."""
        limit = {"limit": _PAGE} if view in (View.LIST, View.SURFACES, View.OUTPUTS) else {}
        return (yield from self._all(_request(view, workspace, {**given, **limit})))

    def content(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[bytes]:
        """Return the bytes of a table (in the form `accept`), a window, a shape or its layer."""
        given = dict(given)
        accept = {"Accept": given.pop("accept")} if "accept" in given else {}
        answer = yield from self.asking.ask(_request(view, workspace, given, accept))
        return answer.body

    def file(self, workspace: str, path: str, begin: int, count: int, tag: str) -> Steps[FilePart]:
        """Return up to `count` bytes of a file from `begin` on; all of it anew if it changed."""
        place = f"{_workspace(workspace)}/{quote(path)}"
        headers = {"Range": f"bytes={begin}-{begin + count - 1}"}
        if tag:
            headers["If-Range"] = tag
        try:
            answer = yield from self.asking.ask(Request("GET", place, headers=headers))
        except RequestRefusedError as error:
            if error.code is not Refusal.RANGE_NOT_SATISFIABLE:
                raise
            # An empty file has no range, and one that became shorter is another.
            answer = yield from self.asking.ask(Request("GET", place))
        tag = answer.headers.get("etag", "")
        if answer.status != _PARTIAL:
            return FilePart(answer.body, 0, len(answer.body), tag)
        span, _, size = answer.headers["content-range"].removeprefix("bytes ").partition("/")
        return FilePart(answer.body, int(span.partition("-")[0]), int(size), tag)

    def remove_output(self, workspace: str, name: str) -> Steps[None]:
        """Remove what a job wrote for its user."""
        place = f"{_workspace(workspace)}/outputs/{quote(name, safe='')}"
        yield from self.asking.ask(Request("DELETE", place))

    def uploads(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the uploads that are open or wait for their import."""
        content = yield from self._all(Request("GET", _uploads(workspace), {"limit": _PAGE}))
        found: list[dict[str, Any]] = content["uploads"]
        return found

    def begin_upload(self, workspace: str, asked: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Begin an upload."""
        return (yield from self.asking.json(Request("POST", _uploads(workspace), json=asked)))

    def upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Return an upload and how many bytes have arrived."""
        return (yield from self.asking.json(Request("GET", _uploads(workspace, upload))))

    def send_part(self, workspace: str, upload: str, offset: int, body: bytes) -> Steps[None]:
        """Send bytes of an upload, once: raises `LostConnectionError`."""
        headers = {"Upload-Offset": str(offset), "Content-Type": _PART_TYPE}
        request = Request("PATCH", _uploads(workspace, upload), headers=headers, body=body)
        answer: Answer = yield Send(request)
        self.asking.check(answer)

    def complete_upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Check the checksum of an upload, and keep it for a job."""
        place = _uploads(workspace, f"{upload}/complete")
        return (yield from self.asking.json(Request("POST", place), repeat=True))

    def remove_imported(self, workspace: str) -> Steps[dict[str, int]]:
        """Remove the uploads that finished jobs have brought into the workspace."""
        return (yield from self.asking.json(Request("DELETE", _uploads(workspace)), repeat=True))

    def submit(self, request: JobRequest) -> Steps[Job]:
        """Submit a job; the same key again gives the same job."""
        asked = {
            "kind": request.kind.value,
            "parameters": dict(request.parameters),
            "priority": request.priority,
            "after": list(request.after),
        }
        place = f"{_workspace(request.workspace)}/jobs"
        headers = {"Idempotency-Key": request.key}
        sent = Request("POST", place, headers=headers, json=asked)
        return Job.from_json((yield from self.asking.json(sent, repeat=True)))

    def job(self, identity: str) -> Steps[Job]:
        """Return a job."""
        return Job.from_json((yield from self.asking.json(Request("GET", _job(identity)))))

    def jobs(self, workspace: str, states: Sequence[JobState], limit: int) -> Steps[list[Job]]:
        """Return jobs, the newest first."""
        place = f"{_workspace(workspace)}/jobs" if workspace else f"{_API}/jobs"
        query: dict[str, Any] = {"limit": min(limit, _PAGE)}
        if states:
            query["state"] = [state.value for state in states]
        found = yield from self._all(Request("GET", place, query), most=limit)
        return [Job.from_json(one) for one in found["jobs"][:limit]]

    def cancel(self, identity: str) -> Steps[Job]:
        """Cancel a job."""
        request = Request("POST", f"{_job(identity)}/cancel")
        return Job.from_json((yield from self.asking.json(request, repeat=True)))

    def log(self, identity: str) -> Steps[list[dict[str, Any]]]:
        """Return the lines of a job's log."""
        request = Request("GET", f"{_job(identity)}/log", {"limit": _PAGE})
        lines: list[dict[str, Any]] = (yield from self._all(request))["lines"]
        return lines

    def events(self, job: str, workspace: str, after: int | None) -> Emitting[Event]:
        """Emit events as they happen; a lost connection goes on after the last one."""
        query = {name: value for name, value in (("job", job), ("workspace", workspace)) if value}
        while True:
            headers = {"Accept": "text/event-stream"}
            if after is not None:
                headers["Last-Event-ID"] = str(after)
            request = Request("GET", f"{_API}/events", query, headers)
            yield from self.asking.ask(request, stream=True)
            fields: dict[str, str] = {}
            try:
                while (line := (yield NextLine())) is not None:
                    if line:
                        name, _, value = line.partition(":")
                        fields[name] = value.strip()
                        continue
                    if "data" in fields:
                        after = int(fields["id"])
                        yield Emit(
                            Event.from_json(after, fields["event"], json.loads(fields["data"]))
                        )
                    fields = {}
            except LostConnectionError:
                pass
            yield Pause(_AGAIN_S)

    def _all(self, request: Request, most: float = float("inf")) -> Steps[dict[str, Any]]:
        """Return a JSON object whose list has the entries of all pages, `most` or somewhat more."""
        answer = yield from self.asking.ask(request)
        content = self.asking.parsed(answer)
        while (link := answer.headers.get("link")) and 'rel="next"' in link:
            name = next(key for key, value in content.items() if isinstance(value, list))
            if len(content[name]) >= most:
                break
            parts = urlsplit(link.partition("<")[2].partition(">")[0])
            query: dict[str, Any] = {}
            for key, value in parse_qsl(parts.query, keep_blank_values=True):
                query.setdefault(key, []).append(value)
            answer = yield from self.asking.ask(Request("GET", parts.path, query))
            content[name] += self.asking.parsed(answer)[name]
        return content


def _request(
    view: View,
    workspace: str,
    given: Mapping[str, Any],
    headers: Mapping[str, str] | None = None,
) -> Request:
    """Return the request of a view: what is not in the path of its route is in the query."""
    names = [name for _, name, _, _ in Formatter().parse(view) if name]
    path = view.format(**{name: quote(str(given[name]), safe="") for name in names})
    query = {key: value for key, value in given.items() if key not in names and value is not None}
    return Request("GET", f"{_workspace(workspace)}{path}", query, headers or {})


def _workspace(name: str) -> str:
    return f"{_API}/workspaces/{quote(name, safe='')}"


def _uploads(workspace: str, upload: str = "") -> str:
    return f"{_workspace(workspace)}/uploads" + (f"/{upload}" if upload else "")


def _job(identity: str) -> str:
    return f"{_API}/jobs/{quote(identity, safe='')}"
