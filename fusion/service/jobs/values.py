"""What a job is, what it is asked to do, and what has become of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Self


class JobState(StrEnum):
    """Where a job stands."""

    WAITING = "waiting"
    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen to the job."""
        return self in {JobState.FINISHED, JobState.FAILED, JobState.CANCELLED}


class JobKind(StrEnum):
    """What a worker does."""

    RUN = "run"  # stages of a workspace
    IMPORT = "import"  # uploaded lidar files
    IMAGES = "images"  # uploaded images
    INIT = "init"  # a workspace from uploaded SPC files and a shape
    FORECAST = "forecast"  # time, memory and disk of a run
    SCALE_APPLY = "scale-apply"  # a scaled solution
    SUMFILES = "sumfiles"  # states of images
    KERNELS = "kernels"  # SPICE kernels of the states
    PHOTOMETRY_FIT = "photometry-fit"  # photometric functions of the images
    SPC_TILE = "spc-tile"  # a solution with finer maplets
    SPC_REGISTER = "spc-register"  # a solution with states that fit the shape
    SPC_LITHOS = "spc-lithos"  # a solution with maplets from images
    FUSE_IMAGES = "fuse-images"  # the same with lidar and overlaps in every round
    SPC_ALBEDO = "spc-albedo"  # albedo on known topography
    SOLUTION_USE = "solution-use"
    SOLUTION_EXPORT = "solution-export"
    SOLUTION_REMOVE = "solution-remove"
    TRUTH_ASSESS = "truth-assess"  # models against a synthetic mission
    CAMERA_CALIBRATE = "camera-calibrate"  # a camera from stars
    CAMERA_CONVERT = "camera-convert"  # a camera file of other formats
    INFO = "info"  # what a file holds
    LOOK = "look"  # a picture of a file or the workspace
    SOLUTION_DIFF = "solution-diff"

    @property
    def only_reads(self) -> bool:
        """Whether it changes nothing in the workspace, and goes along with any other job."""
        return self in {JobKind.INFO, JobKind.LOOK, JobKind.SOLUTION_DIFF}


@dataclass(frozen=True)
class JobRequest:
    """A job as it is submitted.

    Parameters
    ----------
    kind : JobKind
    workspace : str
        Name of the workspace.
    user : str
    parameters : mapping
        What the kind of job takes, as JSON: of a run `stages`, `settings` (tables as in
        ``spcola.toml``), `solution`, `only`, `within`, `accept`, `force`; of
        other kinds the options of the command.
    priority : int
        From -100 to 100; of one user's jobs, those with the highest begin first.
    after : tuple of str
        Jobs that have to be finished before. If one of them fails or is cancelled, this one fails.
    key : str
        Idempotency key: a second request of the same user with it gives the first one's job.
    """

    kind: JobKind
    workspace: str
    user: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    priority: int = 0
    after: tuple[str, ...] = ()
    key: str = ""


@dataclass(frozen=True)
class JobProgress:
    """How far a running job is.

    Parameters
    ----------
    stage, task : str
        Name of the stage, and of the work in it.
    done, total : int
        Items; `total` is 0 if it is unknown.
    remaining_s : float
        Time that the task still takes; NaN if unknown.
    kept : int
        What this worker has finished and no other has to do again: items and stages.
    """

    stage: str = ""
    task: str = ""
    done: int = 0
    total: int = 0
    remaining_s: float = float("nan")
    kept: int = 0


@dataclass(frozen=True)
class JobError:
    """Why a job failed: a code for programs, a line for people, and the item if it was one."""

    code: str
    text: str
    item: str = ""


@dataclass(frozen=True)
class Job:
    """A job and what has become of it; times are seconds since 1970, UTC.

    Parameters
    ----------
    id : str
        Sorts in the order of submission.
    request : JobRequest
    state : JobState
    tries : int
        How often a worker has begun it.
    submitted, begun, ended : float
        NaN if it has not happened yet.
    progress : JobProgress
    result : mapping
        What ``--json`` of the command has: of a finished job, and of one that failed with a
        result that may not be used.
    error : JobError, optional
    cancelling : bool
        Whether the worker has been asked to stop.
    """

    id: str
    request: JobRequest
    state: JobState
    tries: int
    submitted: float
    begun: float
    ended: float
    progress: JobProgress = JobProgress()
    result: Mapping[str, Any] = field(default_factory=dict)
    error: JobError | None = None
    cancelling: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return the job in JSON types, but for times that are NaN."""
        request, progress = self.request, asdict(self.progress)
        remaining = self.progress.remaining_s
        progress["remaining_s"] = None if math.isnan(remaining) else remaining
        return {
            "id": self.id,
            "kind": request.kind,
            "workspace": request.workspace,
            "user": request.user,
            "parameters": dict(request.parameters),
            "priority": request.priority,
            "after": list(request.after),
            "state": self.state,
            "tries": self.tries,
            "submitted": self.submitted,
            "begun": self.begun,
            "ended": self.ended,
            "progress": progress,
            "result": dict(self.result),
            "error": self.error and asdict(self.error),
            "cancelling": self.cancelling,
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Return the job of :meth:`as_json`; the idempotency key is not in it.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it is no job.
        """
        names = ("workspace", "user", "parameters", "priority")
        request = JobRequest(
            JobKind(content["kind"]),
            **{name: content[name] for name in names},
            after=tuple(content["after"]),
        )
        error, times = content["error"], ("submitted", "begun", "ended")
        return cls(
            id=content["id"],
            request=request,
            state=JobState(content["state"]),
            tries=content["tries"],
            **{name: _number(content[name]) for name in times},
            progress=JobProgress(**_with_number(content["progress"], "remaining_s")),
            result=content["result"],
            error=None if error is None else JobError(**error),
            cancelling=content["cancelling"],
        )


@dataclass(frozen=True)
class Event:
    """Something that happened to a job; `number` grows by each event of the service."""

    number: int
    job: str
    workspace: str
    time: float
    kind: str  # "state", "progress", "note"
    content: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Return the content with the job, its workspace and the time."""
        shared = {"job": self.job, "workspace": self.workspace, "time": self.time}
        return {**shared, **dict(self.content)}

    @classmethod
    def from_json(cls, number: int, kind: str, content: Mapping[str, Any]) -> Self:
        """Return the event of :meth:`as_json`."""
        shared = {name: content[name] for name in ("job", "workspace", "time")}
        others = {name: value for name, value in content.items() if name not in shared}
        return cls(number, **shared, kind=kind, content=others)


def _number(value: float | None) -> float:
    """Return a number of JSON, in which NaN is null."""
    return math.nan if value is None else value


def _with_number(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {**content, name: _number(content[name])}
