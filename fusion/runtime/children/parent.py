"""A process that ends with its parent."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import threading


def end_with_parent(descriptor: int, how: signal.Signals = signal.SIGKILL) -> None:
    """Have the kernel send this process a signal when its parent is gone, however that ended.

    A thread that waits for it would not run while a library keeps the interpreter's lock, and
    PR_SET_PDEATHSIG is about the thread that started this process, not about its process.

    Parameters
    ----------
    descriptor : int
        Reading end of a pipe whose writing end only the parent has.
    how : Signals
    """
    if not hasattr(fcntl, "F_SETSIG"):  # not on macOS
        threading.Thread(target=_wait, args=(descriptor, how), daemon=True).start()
        return
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(descriptor, fcntl.F_SETSIG, how)
    flags = fcntl.fcntl(descriptor, fcntl.F_GETFL)
    fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_ASYNC)
    # It may have been gone before.
    if select.select([descriptor], [], [], 0.0)[0]:
        os.kill(os.getpid(), how)


def _wait(descriptor: int, how: signal.Signals) -> None:
    os.read(descriptor, 1)
    os.kill(os.getpid(), how)
