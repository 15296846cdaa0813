"""Why and how the work on a job is stopped."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from types import FrameType

from fusion.runtime.processes import remembering_interrupts


class Stop(StrEnum):
    """Why the work on a job is stopped."""

    DRAIN = "drain"  # the worker is to end
    CANCEL = "cancel"  # the user wants no more of it
    LOST = "lost"  # it belongs to another worker by now
    TOO_LONG = "too-long"  # no progress for longer than a file may take


class Stopper:
    """Stops the work of the main thread, once for each job, as Ctrl-C does.

    What is under way on the executor is finished and kept; nothing more begins. SIGTERM, and
    Ctrl-C, stop the current job and let no other begin (`draining`).
    """

    def __init__(self) -> None:
        self.draining = False
        self.reason: Stop | None = None
        self._is_open = False
        # The handler of a signal runs in the main thread, which may have the lock.
        self._lock = threading.RLock()

    @contextmanager
    def heeding_signals(self) -> Iterator[None]:
        """Handle SIGTERM and SIGINT as long as the context is open; in the main thread only."""
        former = [signal.signal(one, self._drain) for one in (signal.SIGTERM, signal.SIGINT)]
        try:
            yield
        finally:
            signal.signal(signal.SIGTERM, former[0])
            signal.signal(signal.SIGINT, former[1])

    @contextmanager
    def stoppable(self) -> Iterator[None]:
        """Let the work in this context be stopped: KeyboardInterrupt is raised in it then."""
        former = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with remembering_interrupts():
                self.reason, self._is_open = None, True
                try:
                    if self.draining:
                        self.stop(Stop.DRAIN)
                    yield
                finally:
                    with self._lock:
                        self._is_open = False
        finally:
            signal.signal(signal.SIGINT, former)

    def stop(self, reason: Stop) -> None:
        """Stop the work, from any thread; the first reason counts."""
        with self._lock:
            if self._is_open and self.reason is None:
                self.reason = reason
                signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)

    def _drain(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        self.draining = True
        self.stop(Stop.DRAIN)
