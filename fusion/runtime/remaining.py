"""How long work over items still takes, from the items that are done."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

__all__ = ["RemainingTime", "Spent", "Timed", "note_done", "note_found"]

Item = TypeVar("Item")
Result = TypeVar("Result")


class _Work(threading.local):
    """Whether the work on the current item of this thread was found finished, or done."""

    found = False
    done = False


_work = _Work()


def note_found() -> None:
    """Note that a result of the current item was found finished: its time is that of no work."""
    _work.found = True


def note_done() -> None:
    """Note that a result of the current item was computed, and is kept."""
    _work.done = True


@dataclass(frozen=True)
class Spent:
    """What an item took: its seconds, NaN if its result was found finished.

    `is_kept` is whether a result of it was computed and kept, so that nobody computes it again.
    """

    seconds: float
    is_kept: bool = False


@dataclass(frozen=True)
class Timed(Generic[Item, Result]):
    """A function that also returns what it took."""

    function: Callable[[Item], Result]

    def __call__(self, item: Item) -> tuple[Result, Spent]:
        """Return ``function(item)`` and what it took."""
        _work.found = _work.done = False
        begun = time.monotonic()
        result = self.function(item)
        only_found = _work.found and not _work.done
        seconds = math.nan if only_found else time.monotonic() - begun
        return result, Spent(seconds, _work.done)


@dataclass
class RemainingTime:
    """Time that items still take.

    The first item that each worker computes does not count, as its code may be compiled meanwhile;
    nor do items that were found finished, as the others may have to be computed, and those without
    work, as none of the others is like them.

    Parameters
    ----------
    sizes : sequence of float
        Work in each item, in any unit, in the order in which they are done.
    workers : int
        Items that are worked on at a time.
    """

    sizes: Sequence[float]
    workers: int
    _seconds: list[float] = field(default_factory=list)

    def add(self, seconds: float) -> None:
        """Count the next item as done; `seconds` is from :class:`Spent`."""
        self._seconds.append(seconds)

    @property
    def seconds(self) -> float:
        """Seconds until all items are done; NaN as long as nothing can be said."""
        left = sum(self.sizes[len(self._seconds) :])
        if not left:
            return 0.0
        done = zip(self._seconds, self.sizes, strict=False)
        known = [(each, size) for each, size in done if size and not math.isnan(each)]
        counted = known[self.workers :]
        work = sum(size for _, size in counted)
        if not work:
            return math.nan
        return sum(each for each, _ in counted) / work * left / self.workers
