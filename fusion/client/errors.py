"""What can go wrong between a client and its server, and jobs that fail."""

from __future__ import annotations

from fusion.service.faults import error_class
from fusion.service.jobs import Job, JobState
from spcola.errors import SpcolaError


class VersionWarning(UserWarning):
    """Server and client are of different versions."""


class UnreachableError(SpcolaError):
    """The server does not answer, or something else answers at its address."""


class JobFailedError(SpcolaError):
    """A job failed for a reason that no other error has, or was cancelled.

    Parameters
    ----------
    job : Job
        `job.error.code` is for programs, and `job.error.item` names the item if it was one.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        text = "was cancelled" if job.state is JobState.CANCELLED else "failed"
        super().__init__(job.error.text if job.error else text, job_name(job))


def job_name(job: Job) -> str:
    """Return how messages name a job."""
    return f"job {job.id}"


def failure(job: Job) -> SpcolaError:
    """Return the error of a job that failed: of the class that the command would raise."""
    kind = error_class(job.error.code) if job.error else None
    return JobFailedError(job) if kind is None or job.error is None else kind(job.error.text)
