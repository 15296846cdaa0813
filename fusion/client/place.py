"""Where workspaces are: what a server and a local folder both offer, as steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

from fusion.client.steps import Emitting, Steps
from fusion.service.jobs import Event, Job, JobRequest, JobState


class View(StrEnum):
    """What can be read of a workspace, by the path of its route below that of the workspace."""

    OVERVIEW = ""
    COVERAGE = "/coverage"
    LIST = "/{kind}"
    OUTLINES = "/outlines"
    RESULT = "/results/{name}"
    TABLES = "/tables"
    TABLE = "/tables/{name}"
    RESIDUALS = "/registration/residuals"
    EPSILON = "/scale/epsilon"
    SOLVED = "/photoclinometry"
    SOLVED_MAPLET = "/photoclinometry/{maplet}"
    SOLUTIONS = "/solutions"
    SOLUTION = "/solutions/{name}"
    SOLUTIONS_COMPARED = "/solutions/{first}/diff/{second}"
    OUTPUTS = "/outputs"
    RUNS = "/runs"
    RUN = "/runs/{run}"
    RUNS_COMPARED = "/runs/{first}/diff/{second}"
    PROVENANCE = "/provenance"
    SURFACES = "/surfaces"
    SURFACE = "/surfaces/{kind}/{name}"
    WINDOW = "/surfaces/{kind}/{name}/window"
    VALUE = "/surfaces/{kind}/{name}/value"
    PROFILE = "/surfaces/{kind}/{name}/profile"
    SHAPE = "/shape"
    SHAPE_LAYERS = "/shape/layers"
    SHAPE_LAYER = "/shape/layers/{layer}"


@dataclass(frozen=True)
class FilePart:
    """Part of a file; `tag` changes with the file, and `size` is that of all of it."""

    content: bytes
    begin: int
    size: int
    tag: str


class Place(Protocol):
    """A server, or a local folder."""

    @property
    def name(self) -> str:
        """Address or path."""
        ...

    def workspaces(self) -> Steps[list[str]]:
        """Return the names of the workspaces."""
        ...

    def view(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Return JSON: a view, of lists all pages."""
        ...

    def content(self, view: View, workspace: str, given: Mapping[str, Any]) -> Steps[bytes]:
        """Return the bytes of a table (in the form `accept`), a window, a shape or its layer."""
        ...

    def file(self, workspace: str, path: str, begin: int, count: int, tag: str) -> Steps[FilePart]:
        """Return up to `count` bytes of a file from `begin` on; all of it anew if it changed.

        `path` is ``files/…`` in the workspace, or ``outputs/…`` of jobs.
        """
        ...

    def remove_output(self, workspace: str, name: str) -> Steps[None]:
        """Remove what a job wrote for its user: a file, or a folder with all that is in it."""
        ...

    def uploads(self, workspace: str) -> Steps[list[dict[str, Any]]]:
        """Return the uploads that are open or wait for their import."""
        ...

    def begin_upload(self, workspace: str, asked: Mapping[str, Any]) -> Steps[dict[str, Any]]:
        """Begin an upload."""
        ...

    def upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Return an upload and how many bytes have arrived."""
        ...

    def send_part(self, workspace: str, upload: str, offset: int, body: bytes) -> Steps[None]:
        """Send bytes of an upload, once: raises `LostConnectionError`."""
        ...

    def complete_upload(self, workspace: str, upload: str) -> Steps[dict[str, Any]]:
        """Check the checksum of an upload, and keep it for a job."""
        ...

    def remove_imported(self, workspace: str) -> Steps[dict[str, int]]:
        """Remove the uploads that finished jobs have brought into the workspace."""
        ...

    def submit(self, request: JobRequest) -> Steps[Job]:
        """Submit a job; the same key again gives the same job."""
        ...

    def job(self, identity: str) -> Steps[Job]:
        """Return a job."""
        ...

    def jobs(self, workspace: str, states: Sequence[JobState], limit: int) -> Steps[list[Job]]:
        """Return jobs, the newest first."""
        ...

    def cancel(self, identity: str) -> Steps[Job]:
        """Cancel a job."""
        ...

    def log(self, identity: str) -> Steps[list[dict[str, Any]]]:
        """Return the lines of a job's log."""
        ...

    def events(self, job: str, workspace: str, after: int | None) -> Emitting[Event]:
        """Emit events as they happen."""
        ...


class Viewing:
    """Base of calls that read views of a place."""

    place: Place

    def _view(self, view: View, workspace: str, **given: Any) -> Steps[dict[str, Any]]:
        given["solution"] = given.get("solution") or None
        return (yield from self.place.view(view, workspace, given))
