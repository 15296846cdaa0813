"""Progress of a job: its stage and task for the lease, its notes for the log, its spans."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import structlog

from fusion.runtime import Progress
from fusion.runtime.children import ItemRun
from fusion.runtime.progress import Task
from fusion.service.jobs import Job, JobProgress
from fusion.service.tracing import Span, begin_span, end_span
from fusion.service.work.logs import log


class JobReport(Progress):
    """Keeps how far a job is, for another thread to read.

    Parameters
    ----------
    job : Job
    note : callable
        Takes each line of the log, and its level.
    counts_stages : bool
        Whether a stage that ended is not run again by the next worker.
    """

    def __init__(
        self, job: Job, note: Callable[[str, str], None], *, counts_stages: bool = False
    ) -> None:
        super().__init__("silent")
        self._job, self._note, self._counts_stages = job, note, counts_stages
        self._task: Task | None = None
        self._kept = 0
        request = job.request
        about = {"job": job.id, "workspace": request.workspace, "user": request.user}
        attributes = {f"spcola.{name}": value for name, value in about.items()}
        self._span = begin_span(f"job {request.kind.value}", attributes)
        self._stage_span: Span = None

    def begin_stage(self, name: str) -> None:
        """Note the stage, and that it begins."""
        # The one before is finished; those that are up to date do not begin.
        self._end_task(finished=self._counts_stages and bool(self.stage))
        super().begin_stage(name)
        structlog.contextvars.bind_contextvars(stage=name)
        end_span(self._stage_span)
        attributes = {"spcola.job": self._job.id, "spcola.stage": name}
        self._stage_span = begin_span(f"stage {name}", attributes, parent=self._span)
        self._note(f"{name} begins", "progress")

    def note(self, text: str) -> None:
        """Add what the user should know to the job's log."""
        self._note(text, "warning")

    def result_line(self, text: str) -> None:
        """Add a line that the command prints to the job's log."""
        self._note(text, "result")

    def item_done(self, run: ItemRun) -> None:
        """Log an item, and what became of it; from any thread."""
        task = "" if self._task is None else self._task.title
        about = {"job": self._job.id, "stage": self.stage, "task": task, "item": run.name}
        about |= {"cluster_worker": run.worker} if run.worker else {}
        seconds = None if math.isnan(run.seconds) else round(run.seconds, 3)
        if run.deaths or run.error:
            deaths = list(run.deaths)
            log.warning("item", **about, seconds=seconds, deaths=deaths, error=run.error)
        else:
            log.debug("item", **about, seconds=seconds)
        attributes = {f"spcola.{name}": value for name, value in about.items()}
        parent = self._stage_span or self._span
        ended_s = time.time() if math.isnan(run.ended) else run.ended
        begun_s = ended_s - (seconds or 0.0)
        span = begin_span("item", attributes, parent=parent, begun_s=begun_s)
        failed: dict[str, Any] = {"error": run.error} if run.error else {}
        end_span(span, ended_s=ended_s, tries=1 + len(run.deaths), **failed)

    def end(self, outcome: str) -> None:
        """Note what became of the job."""
        failed: dict[str, Any] = {} if outcome == "finished" else {"error": outcome}
        end_span(self._stage_span, **failed)
        end_span(self._span, outcome=outcome, **failed)

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
