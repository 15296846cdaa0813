"""The interface of a queue of jobs; :class:`fusion.service.store.Store` implements it on SQL."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Protocol

from fusion.service.jobs.values import (
    Event,
    Job,
    JobError,
    JobProgress,
    JobRequest,
    JobState,
)


class JobQueue(Protocol):
    """Jobs that outlive the processes that submit and execute them."""

    def submit(self, request: JobRequest) -> Job:
        """Add a job; a request with a known idempotency key gives the job of its first time."""
        ...

    def job(self, identity: str) -> Job:
        """Return a job; raises `UnknownJobError`."""
        ...

    def jobs(
        self,
        *,
        workspaces: Collection[str] | None = None,
        states: Collection[JobState] | None = None,
        user: str = "",
        before: str = "",
        limit: int = 100,
    ) -> list[Job]:
        """Return jobs, the newest first; `before` is the last one of the page before."""
        ...

    def claim(self, worker: str, lease_s: float) -> Job | None:
        """Take the next job that may begin.

        Jobs whose `after` are all finished may; not while another job runs on the same workspace
        and solution. The user with the fewest running jobs comes first, then the one whose last
        job began the longest ago; of one user's jobs the highest priority, then the oldest.
        Jobs of workers whose lease has ended are waiting again.
        """
        ...

    def renew(self, identity: str, worker: str, lease_s: float, progress: JobProgress) -> bool:
        """Renew a lease and record progress; return whether the job is to be cancelled.

        Raises `LeaseLostError` if the job belongs to another worker by now.
        """
        ...

    def note(self, identity: str, text: str, content: Mapping[str, Any] | None = None) -> None:
        """Add a line to the job's log; `content` may have a `level`, and a `code`."""
        ...

    def finish(self, identity: str, worker: str, result: Mapping[str, Any]) -> None:
        """Record the result of a job."""
        ...

    def fail(
        self,
        identity: str,
        worker: str,
        error: JobError,
        result: Mapping[str, Any] | None = None,
    ) -> None:
        """Record that a job failed, with a result that may not be used; fail those after it."""
        ...

    def give_back(self, identity: str, worker: str, *, wait_s: float = 0.0) -> None:
        """Let a job wait again, for a time: a drained worker, a full disk, a lost scheduler."""
        ...

    def cancel(self, identity: str) -> Job:
        """Cancel a waiting job at once; ask the worker of a running one to stop."""
        ...

    def events(
        self,
        after: int = 0,
        *,
        job: str = "",
        workspaces: Collection[str] | None = None,
        limit: int = 1000,
    ) -> Sequence[Event]:
        """Return events with larger numbers than `after`, in their order."""
        ...
