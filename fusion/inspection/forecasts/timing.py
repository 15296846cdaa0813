"""Items that are timed with all workers at work, and measured in memory and on disk."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar

from fusion.pipeline.items import ItemStore, encode
from fusion.runtime import ThreadExecutor
from spcola.errors import WorkspaceError

Result = TypeVar("Result")
# Timed calls of each worker, as long as they take less than this together.
_CALLS, _LONG_S = 4, 1.0


@dataclass(frozen=True)
class Cost:
    """Cost of one item.

    Attributes
    ----------
    seconds : float
        With all workers at work: so many items take so many times longer.
    memory_bytes : float
        Of one worker.
    kept_bytes : float
        Of its result as a kept item.
    """

    seconds: float
    memory_bytes: float = 0.0
    kept_bytes: float = 0.0


def cost_of(function: Callable[[], Any], workers: int) -> Cost:
    """Return the cost of a call, after one that does not count: its code may be compiled then."""
    kept = encode(function())
    tracemalloc.start()
    try:
        function()
        memory = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    done, begun = 0, time.perf_counter()
    while done < _CALLS * workers and time.perf_counter() - begun < _LONG_S:
        for _ in ThreadExecutor(workers).stream(lambda _: function(), range(workers)):
            done += 1
    seconds = (time.perf_counter() - begun) / done
    return Cost(seconds, memory, sum(array.nbytes for array in kept.arrays) + len(kept.text))


@dataclass(frozen=True)
class NotingStore(ItemStore):
    """Keeps items as :class:`ItemStore`, and notes how many were computed.

    Where the workspace cannot be written, results are not kept.
    """

    computed: list[str] = field(default_factory=list)

    def result(self, function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
        """Return the kept result, or a new one."""

        @wraps(function)
        def noted(*given: Any, **further: Any) -> Result:
            self.computed.append(function.__name__)
            return function(*given, **further)

        try:
            return super().result(noted, *arguments, **options)
        except WorkspaceError:
            if any(self.folder.glob("*.npz")) or self.folder.is_dir():
                raise
            return function(*arguments, **options)

    @property
    def count(self) -> int:
        """Number of items that are kept."""
        return sum(1 for _ in self.folder.glob("*.npz")) if self.folder.is_dir() else 0


@dataclass(frozen=True)
class Sample:
    """Items of a stage that were timed.

    Attributes
    ----------
    seconds : float
        Of one item that has to be computed, all workers at work.
    kept_seconds : float
        Of one that was found kept.
    kept_share : float
        Share of the sampled items that had been kept before.
    """

    seconds: float
    kept_seconds: float
    kept_share: float


def timed_sample(
    names: Sequence[str], one: Callable[[str], Any], store: NotingStore, workers: int
) -> Sample:
    """Make some items of a stage as the stage does, evenly taken from all, and time them.

    The first of each worker does not count, as its code may be compiled meanwhile.

    Parameters
    ----------
    names : sequence of str
        Of all items; not empty.
    one : callable
        Makes the item of a name, through `store`.
    store : NotingStore
    workers : int
    """
    count = min(len(names), 3 * workers)
    chosen = [names[k * len(names) // count] for k in range(count)]
    store.computed.clear()
    first = chosen[:workers] if len(chosen) > workers else chosen[:1]
    list(ThreadExecutor(workers).stream(one, first))
    found = len(first) - len(store.computed)
    rest = chosen[len(first) :] or chosen
    before, begun = len(store.computed), time.perf_counter()
    list(ThreadExecutor(workers).stream(one, rest))
    took = time.perf_counter() - begun
    computed = len(store.computed) - before
    found += len(rest) - computed if rest is not chosen else 0
    share = found / len(chosen)
    each = took / len(rest)
    if computed:
        return Sample(took / computed, 0.1 * each, share)
    return Sample(each, each, share)
