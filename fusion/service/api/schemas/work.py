"""Answers about the process, jobs, uploads, outputs, and who asks."""

from __future__ import annotations

from typing import Any, Literal

from fusion.service.api.schemas.base import Form, Media, Open, form_of, listing
from fusion.service.jobs import Job, JobKind, JobRequest
from fusion.service.jobs.values import JobError, JobProgress
from fusion.service.store import Scope, Token, Upload
from fusion.service.store.records import AuditEntry

JOB: Any = form_of(
    JobRequest, Job, name="Job", without=("key", "request", "progress", "error"),
    progress=form_of(JobProgress, name="JobProgress"),
    error=form_of(JobError, name="JobError") | None,
)  # fmt: skip
JOBS = listing("jobs", JOB)
UPLOAD: Any = form_of(Upload, name="Upload", without=("workspace", "changed"))
UPLOADS = listing("uploads", UPLOAD)
TOKEN: Any = form_of(Token, name="Token")
TOKENS = listing("tokens", TOKEN)
NEW_TOKEN = form_of(Token, name="NewToken", secret=str)
ENTRIES = listing("entries", form_of(AuditEntry, name="AuditEntry"))
EVENTS = Media(("text/event-stream",))
METRICS = Media(("text/plain",))
PROGRESS = {
    "Upload-Offset": "Bytes that have arrived.",
    "Upload-Length": "Bytes of the whole file.",
    "Tus-Resumable": "Version of the protocol tus.",
}
"""Headers that say how much of an upload has arrived."""


class Health(Form):
    """That the process lives."""

    status: Literal["ok"]
    version: str


class Ready(Form):
    """That the service can work, and what is wrong with what it needs."""

    status: Literal["ready"]
    checks: dict[str, str]


class Interface(Open):
    """A description in OpenAPI."""

    openapi: str
    paths: dict[str, Any]


class Kind(Form):
    """A kind of job: its command, the JSON schema of its parameters, and an example of them."""

    kind: JobKind
    command: str
    parameters: dict[str, Any]
    example: dict[str, Any]


class Line(Open):
    """A line of a log."""

    number: int
    time: float
    text: str


class Removed(Form):
    """How many uploads were removed, and their bytes."""

    removed: int
    bytes: int


class Output(Form):
    """A file that a job has written."""

    name: str
    bytes: int


class Caller(Form):
    """Who asks, and the scopes by workspace."""

    user: str
    scopes: dict[str, Scope]


KINDS = listing("kinds", Kind)
LINES = listing("lines", Line)
OUTPUTS = listing("outputs", Output)
