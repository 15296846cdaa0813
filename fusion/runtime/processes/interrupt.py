"""Ctrl-C that is not lost.

Python raises :class:`KeyboardInterrupt` wherever the main thread happens to be. If that is a
callback of a library (a finaliser, a loader of compiled code), the exception is printed or dropped
there and the work goes on for hours. So an interrupt is also remembered, and checked for between
two pieces of work.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from fusion.runtime.processes.early_exit import leave_at_once

_interrupted = threading.Event()


@contextmanager
def remembering_interrupts() -> Iterator[None]:
    """Remember Ctrl-C as long as the context is open.

    Outside the main thread, and where interrupts are ignored or another program part handles
    them, nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(
        signal.SIGINT
    ) not in (signal.default_int_handler, leave_at_once):
        yield
        return
    former = signal.getsignal(signal.SIGINT)
    hook, sys.unraisablehook = sys.unraisablehook, _quiet
    _interrupted.clear()
    signal.signal(signal.SIGINT, _remember)
    try:
        yield
    except Exception as error:
        # A library turned it into another error, such as a failed import.
        if _interrupted.is_set():
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, former)
        sys.unraisablehook = hook
        _interrupted.clear()


def check_interrupts() -> None:
    """Raise an interrupt that a library dropped.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came since the context was opened.
    """
    if _interrupted.is_set():
        raise KeyboardInterrupt


def _quiet(unraisable: Any) -> None:
    """Print nothing about an interrupt that a callback dropped: it is remembered."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)


def _remember(number: int, frame: FrameType | None) -> None:
    """Note the interrupt, and raise it as usual."""
    _interrupted.set()
    signal.default_int_handler(number, frame)
