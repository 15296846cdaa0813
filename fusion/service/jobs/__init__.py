"""Jobs of the service as values, and the interface of their queue."""

from fusion.service.jobs.queue import JobQueue
from fusion.service.jobs.values import (
    Event,
    Job,
    JobError,
    JobKind,
    JobProgress,
    JobRequest,
    JobState,
)

__all__ = [
    "Event",
    "Job",
    "JobError",
    "JobKind",
    "JobProgress",
    "JobQueue",
    "JobRequest",
    "JobState",
]
