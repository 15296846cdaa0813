"""One program at a time in a folder."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from fusion.runtime.processes import check_interrupts
from spcola.errors import WorkspaceError

__all__ = ["LOCK_FILE", "BusyError", "is_locked", "locked"]

LOCK_FILE = ".lock"
"""Name of the lock file in a workspace, or in the folder of a solution."""
_ASKED_AGAIN_S = 0.2


class BusyError(WorkspaceError):
    """Another program works in the folder."""


@contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock file `path`, so that no other program works in its folder meanwhile.

    Parameters
    ----------
    path : Path
    wait : bool
        Whether to wait until the other program is done.

    Raises
    ------
    BusyError
        If another program holds it.
    WorkspaceError
        If it was removed meanwhile, or cannot be written.
    """
    try:
        lock = path.open("w", encoding="utf-8")
    except OSError as error:
        raise WorkspaceError(f"cannot be written ({error.strerror})", path) from error
    with lock:
        while not _taken(lock):
            if not wait:
                raise BusyError(
                    "another spcola is at work here", path.parent, "wait until it is done: --wait"
                )
            # A blocking call would keep Ctrl-C from being noticed.
            time.sleep(_ASKED_AGAIN_S)
            check_interrupts()
        if not _is_at(lock, path):
            raise WorkspaceError("was removed by another spcola", path.parent)
        yield


def is_locked(path: Path) -> bool:
    """Return whether another program has locked the file `path`."""
    try:
        lock = path.open("rb")
    except OSError:
        return False
    with lock:
        return not _taken(lock)


def _taken(lock: IO[Any]) -> bool:
    """Take a lock if no other program has it; return whether it was taken."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_at(lock: IO[str], path: Path) -> bool:
    """Return whether an open file still has this path."""
    try:
        return os.path.samestat(os.fstat(lock.fileno()), path.stat())
    except OSError:
        return False
