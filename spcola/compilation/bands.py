"""Bands of rows on several threads: several cores for one large height problem.

A parallel region of Numba must not be entered by two threads at once, and heights are solved on
worker threads. So bands of rows go to a pool of plain threads, as serial kernels without the
GIL. The bands do not depend on the number of threads, hence neither do the sums over them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self, TypeVar

T = TypeVar("T")

_BAND_POINTS = 1_000_000
"""Points of a band of a large grid: the rows computed twice at its borders are few."""
_LEAST_POINTS = 150_000
"""Points of the bands of a smaller grid: the fewest that justify waking a thread."""
_BALANCE = 8
"""Number of bands of a grid that is large enough, or a multiple: equal shares for the threads."""
_MOST_THREADS = 8
"""Memory, not arithmetic, limits the solver: more threads do not make it faster."""


def usable_threads() -> int:
    """Return the default number of threads for a large problem."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(available or 1, _MOST_THREADS)


class Bands:
    """Threads over bands of rows; serial for grids that are no longer than one band.

    Parameters
    ----------
    points : int
        Points of the largest grid; a pool is only made if it has several bands.
    threads : int, optional
        The number of cores (at most 8) if not given.
    """

    def __init__(self, points: int, threads: int | None = None) -> None:
        count = usable_threads() if threads is None else threads
        several = count > 1 and points > _BAND_POINTS
        self._pool = ThreadPoolExecutor(count) if several else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    @staticmethod
    def cut(rows: int, columns: int) -> list[tuple[int, int]]:
        """Return the bands of a grid: first row and row after the last."""
        points = rows * columns
        many = -(-points // (_BAND_POINTS * _BALANCE)) * _BALANCE
        count = min(rows, max(1, min(many, points // _LEAST_POINTS)))
        return [(rows * k // count, rows * (k + 1) // count) for k in range(count)]

    def run(self, size: tuple[int, int], task: Callable[..., T], *arguments: Any) -> list[T]:
        """Return ``task(*arguments, first, last)`` of every band of a grid, in order."""
        if self._pool is None and size[0] * size[1] < _LEAST_POINTS:
            return [task(*arguments, 0, size[0])]
        bands = self.cut(*size)
        if self._pool is None or len(bands) == 1:
            return [task(*arguments, first, last) for first, last in bands]
        return list(self._pool.map(lambda band: task(*arguments, *band), bands))
