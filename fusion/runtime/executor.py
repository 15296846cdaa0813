"""Executors run the work over maplets and scans: the interface, and threads of this machine."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol, TypeVar

from fusion.runtime.machine.threads import one_blas_thread
from fusion.runtime.processes.interrupt import check_interrupts
from spcola.errors import SettingsError, SpcolaError

__all__ = ["AHEAD", "ClusterError", "Executor", "ThreadExecutor", "usable_cores"]

Item = TypeVar("Item")
Result = TypeVar("Result")


AHEAD = 2
"""Default number of results per worker that may wait to be taken."""

# Between kernels a worker needs the interpreter for microseconds; by default Python lets a thread
# keep it for five milliseconds.
_SWITCH_S = 2e-4
# More threads than any machine has cores only take memory, as each has its own returns.
_MOST_WORKERS = 1024


class ClusterError(SpcolaError):
    """A cluster was lost: what was under way can go on when it is back."""


class Executor(Protocol):
    """Interface of what runs calls on workers: threads, or a cluster."""

    workers: int

    def stream(
        self, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int = AHEAD
    ) -> Iterator[Result]:
        """Yield the results in the order of `items`.

        At most `ahead` results per worker wait to be taken. If some calls take many times as long
        as others, a larger `ahead` keeps all workers busy behind a long one.
        """
        ...


class ThreadExecutor:
    """Runs calls on threads: the kernels release the GIL, so that threads use every core.

    The first error, or Ctrl-C, cancels what has not begun, waits for what has (a thread cannot be
    stopped from outside) and is then raised in the caller.

    Parameters
    ----------
    workers : int, optional
        Number of threads; by default the cores that this process may use.

    Raises
    ------
    SettingsError
        If `workers` is less than 1, or more than 1024.
    """

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None and not 1 <= workers <= _MOST_WORKERS:
            raise SettingsError(f"must be 1 to {_MOST_WORKERS}, not {workers}", "workers")
        self.workers = workers or usable_cores()

    def stream(
        self, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int = AHEAD
    ) -> Iterator[Result]:
        """Yield the results in the order of `items`.

        `items` is read as workers become free and at most `ahead` results per worker wait to be
        taken, so that neither side has to fit in memory.
        """
        pool = ThreadPoolExecutor(self.workers, thread_name_prefix="spcola")
        waiting: deque[Future[Result]] = deque()
        usual = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH_S)
        # A BLAS that starts threads of its own in each worker makes small factorisations many
        # times slower.
        with one_blas_thread():
            try:
                for item in items:
                    waiting.append(pool.submit(function, item))
                    if len(waiting) >= ahead * self.workers:
                        yield _taken(waiting)
                while waiting:
                    yield _taken(waiting)
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
                sys.setswitchinterval(usual)


def _taken(waiting: deque[Future[Result]]) -> Result:
    """Return the oldest result, unless Ctrl-C came before it."""
    result = waiting.popleft().result()
    check_interrupts()
    return result


def usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
