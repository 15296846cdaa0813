"""Items that are timed with all workers at work."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from fusion.pipeline.items import ItemStore
from fusion.runtime import ThreadExecutor
from spcola.errors import WorkspaceError

Result = TypeVar("Result")
# Timed calls of each worker, as long as they take less than this together.
_CALLS, _LONG_S = 4, 1.0
# Items of each worker that are timed; tries until one has to be computed; time of one that is found
# kept, seconds.
_EACH, _ROUNDS, _FOUND_S = 2, 4, 0.02


def seconds_of(function: Callable[[], Any], workers: int) -> float:
    """Return the time of a call with all workers at work: so many take so many times longer.

    The first one does not count: its code may be compiled then.
    """
    function()
    seconds: list[float] = []
    while len(seconds) < _CALLS and sum(seconds) < _LONG_S / workers:
        begun = time.perf_counter()
        list(ThreadExecutor(workers).stream(lambda _: function(), range(workers)))
        seconds.append((time.perf_counter() - begun) / workers)
    return float(np.median(seconds))


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
    """Make some items of a stage as the stage does, and time them.

    The first of each worker does not count, as its code may be compiled meanwhile. If all were
    found kept, more are tried.

    Parameters
    ----------
    names : sequence of str
        Of all items; not empty.
    one : callable
        Makes the item of a name, through `store`.
    store : NotingStore
    workers : int
    """
    # Another sample each time, as an earlier one is kept.
    order = np.random.default_rng(store.count).permutation(len(names)).tolist()
    kept = store.count
    store.computed.clear()
    executor = ThreadExecutor(workers)
    list(executor.stream(one, [names[k] for k in order[:workers]]))
    sampled, rest = len(order[:workers]), order[workers:] or order
    took = computed = made = 0.0
    for begin in range(0, _ROUNDS * _EACH * workers, _EACH * workers):
        chosen = [names[k] for k in rest[begin : begin + _EACH * workers]]
        before, begun = len(store.computed), time.perf_counter()
        list(executor.stream(one, chosen))
        took, made = took + time.perf_counter() - begun, made + len(chosen)
        computed += len(store.computed) - before
        if computed or kept >= len(names):
            break
    sampled += int(made) if rest is not order else 0
    share = 1.0 - len(store.computed) / sampled
    each = took / max(made, 1.0)
    return Sample(took / computed if computed else each, min(each, _FOUND_S), share)
