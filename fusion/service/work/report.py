"""Progress of a job: its stage and task for the lease, its notes for the log."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from fusion.runtime import Progress
from fusion.runtime.progress import Task
from fusion.service.jobs import JobProgress


class JobReport(Progress):
    """Keeps how far a job is, for another thread to read.

    Parameters
    ----------
    note : callable
        Takes each line of the log.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        super().__init__("silent")
        self._note = note
        self._task: Task | None = None

    def begin_stage(self, name: str) -> None:
        """Note the stage, and that it begins."""
        super().begin_stage(name)
        self._task = None
        self._note(f"{name} begins")

    def note(self, text: str) -> None:
        """Add a line to the job's log."""
        self._note(text)

    @contextmanager
    def task(self, title: str, total: int | None = None) -> Iterator[Task]:
        """Open a task of `total` parts."""
        self._task = Task(title, total, lambda _: None)
        yield self._task

    def now(self) -> JobProgress:
        """Return how far the job is."""
        task = self._task
        if task is None:
            return JobProgress(self.stage)
        remaining = math.nan if task.remaining is None else task.remaining.seconds
        return JobProgress(self.stage, task.title, task.done, task.total or 0, remaining)
