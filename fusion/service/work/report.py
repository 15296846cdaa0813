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
    counts_stages : bool
        Whether a stage that ended is not run again by the next worker.
    """

    def __init__(self, note: Callable[[str], None], *, counts_stages: bool = False) -> None:
        super().__init__("silent")
        self._note, self._counts_stages = note, counts_stages
        self._task: Task | None = None
        self._kept = 0

    def begin_stage(self, name: str) -> None:
        """Note the stage, and that it begins."""
        # The one before is finished; those that are up to date do not begin.
        self._end_task(finished=self._counts_stages and bool(self.stage))
        super().begin_stage(name)
        self._note(f"{name} begins")

    def note(self, text: str) -> None:
        """Add a line to the job's log."""
        self._note(text)

    @contextmanager
    def task(self, title: str, total: int | None = None) -> Iterator[Task]:
        """Open a task of `total` parts."""
        self._end_task()
        self._task = Task(title, total, lambda _: None)
        yield self._task

    def _end_task(self, *, finished: bool = False) -> None:
        """Count what the last task kept, and the stage if it is finished."""
        kept = 0 if self._task is None else self._task.kept
        # The task first: another thread reads both.
        self._task, self._kept = None, self._kept + kept + finished

    def now(self) -> JobProgress:
        """Return how far the job is."""
        task = self._task
        if task is None:
            return JobProgress(self.stage, kept=self._kept)
        remaining = math.nan if task.remaining is None else task.remaining.seconds
        kept = self._kept + task.kept
        return JobProgress(self.stage, task.title, task.done, task.total or 0, remaining, kept)
