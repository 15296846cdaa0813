"""Progress of long work: a bar on a terminal, plain lines in a pipe, or nothing."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Literal, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as RichProgress

from fusion.runtime.remaining import RemainingTime, Spent

__all__ = ["Progress", "Task"]

PATIENCE_S = 2.0
"""Work shorter than this shows nothing."""
LINE_INTERVAL_S = 10.0
"""Time between two plain lines about one task."""

Mode = Literal["bar", "lines", "silent"]


class Task:
    """A piece of work whose parts are counted; :meth:`advance` counts one as done."""

    def __init__(self, title: str, total: int | None, show: Callable[[Task], None]) -> None:
        self.title = title
        self.total = total
        self.done = 0
        self.kept = 0  # of these, results that nobody computes again
        self.remaining: RemainingTime | None = None
        # What another process, which does the work, states.
        self.stated_s = math.nan
        self.begun = time.monotonic()
        self._show = show

    def advance(self, count: int = 1) -> None:
        """Count `count` more parts as done."""
        self.done += count
        self._show(self)

    def advance_one(self, spent: Spent) -> None:
        """Count one more part as done, which took a worker some time."""
        if self.remaining is not None:
            self.remaining.add(spent.seconds)
        self.kept += spent.is_kept
        self.advance()

    @property
    def elapsed(self) -> float:
        """Seconds since the task began."""
        return time.monotonic() - self.begun

    def text(self) -> str:
        """Return how far the task is, in words."""
        return f"{self.title}: {self.done}" + ("" if self.total is None else f" of {self.total}")

    def time_text(self) -> str:
        """Return the time since the task began, and what it still takes if that is known."""
        seconds = self.stated_s if self.remaining is None else self.remaining.seconds
        left = "" if math.isnan(seconds) else f", about {_duration(seconds)} left"
        return f"{self.elapsed:.0f} s{left}"


def _duration(seconds: float) -> str:
    """Return a time in its usual unit, to two digits."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} s"


class Progress:
    """Reports work on `stream` (standard error): standard output is left to results.

    Parameters
    ----------
    mode : {"bar", "lines", "silent"}
    stream : text stream, optional
    """

    def __init__(self, mode: Mode = "silent", stream: TextIO | None = None) -> None:
        self.mode = mode
        self.stage = ""
        self._console = Console(file=sys.stderr if stream is None else stream)

    @classmethod
    def fitting(cls, *, silent: bool = False) -> Progress:
        """Choose the mode: silent on demand, a bar on a terminal, plain lines elsewhere."""
        if silent:
            return cls("silent")
        return cls("bar" if sys.stderr.isatty() else "lines")

    def begin_stage(self, name: str) -> None:
        """Note the stage of which the next tasks are parts."""
        self.stage = name

    def note(self, text: str) -> None:
        """Print one line, unless silent."""
        if self.mode != "silent":
            self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    @contextmanager
    def items(self, title: str, sizes: Sequence[float], workers: int) -> Iterator[Task]:
        """Open a task over items, of which it is known how much work each is, in any unit."""
        with self.task(title, len(sizes)) as task:
            task.remaining = RemainingTime(sizes, workers)
            yield task

    @contextmanager
    def task(self, title: str, total: int | None = None) -> Iterator[Task]:
        """Open a task of `total` parts (``None``: unknown); one is open at a time."""
        if self.mode == "bar":
            yield from self._with_bar(title, total)
        else:
            yield from self._with_lines(title, total)

    def _with_lines(self, title: str, total: int | None) -> Iterator[Task]:
        printed = 0.0

        def show(task: Task) -> None:
            nonlocal printed
            due = PATIENCE_S if printed == 0.0 else printed + LINE_INTERVAL_S
            if task.elapsed >= due:
                printed = task.elapsed
                self.note(f"{task.text()} ({task.time_text()})")

        task = Task(title, total, show)
        yield task
        if task.elapsed >= PATIENCE_S:
            self.note(f"{task.text()} done in {task.elapsed:.1f} s")

    def _with_bar(self, title: str, total: int | None) -> Iterator[Task]:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[time]}"),
        )
        bar = RichProgress(*columns, console=self._console, transient=True)
        number = bar.add_task(title, total=total, time="")

        def show(task: Task) -> None:
            bar.update(number, completed=task.done, time=task.time_text())

        task = Task(title, total, show)
        late = threading.Timer(PATIENCE_S, bar.start)
        late.start()
        try:
            yield task
        finally:
            late.cancel()
            late.join()
            bar.stop()
        if task.elapsed >= PATIENCE_S:
            self.note(f"{task.text()} done in {task.elapsed:.1f} s")
