"""Progress of jobs and files: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from fusion.runtime import Progress
from fusion.runtime.progress import Task
from fusion.service.jobs import Job, JobState

_MEGABYTE = 1e6


@contextmanager
def job_bar(*, shown: bool = True) -> Iterator[Callable[[Job], None]]:
    """Yield what shows how far a job is, each time that it is called.

    Parameters
    ----------
    shown : bool
        Otherwise nothing is.
    """
    progress, begun = Progress.fitting(silent=not shown), ("", "")
    task: Task | None = None
    with ExitStack() as open_task:

        def show(job: Job) -> None:
            nonlocal task, begun
            now = job.progress
            over = (now.stage, now.task) != begun
            if task is not None and (over or job.state is JobState.FINISHED):
                # What ended between two looks.
                task.done = task.total or task.done
            if over:
                open_task.close()
                begun, task = (now.stage, now.task), None
                if now.task:
                    title = f"{now.stage}: {now.task}" if now.stage else now.task
                    task = open_task.enter_context(progress.task(title, now.total or None))
            if task is not None:
                task.stated_s = now.remaining_s
                task.advance(max(now.done, task.done) - task.done)

        yield show


@contextmanager
def bytes_bar(title: str, size: int, *, shown: bool = True) -> Iterator[Callable[[int], None]]:
    """Yield what shows how many of `size` bytes there are, in megabytes."""
    progress = Progress.fitting(silent=not shown)
    with progress.task(f"{title} (MB)", round(size / _MEGABYTE)) as task:
        yield lambda done: _reach(task, round(done / _MEGABYTE))


def _reach(task: Task, done: int) -> None:
    task.advance(done - task.done)
