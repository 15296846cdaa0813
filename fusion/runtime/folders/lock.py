"""One program at a time in a folder."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spcola.errors import WorkspaceError


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, so that no other program works in its folder meanwhile.

    Raises
    ------
    WorkspaceError
        If another program holds it, or it cannot be written.
    """
    try:
        lock = path.open("w", encoding="utf-8")
    except OSError as error:
        raise WorkspaceError(f"cannot be written ({error.strerror})", path) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise WorkspaceError(
                "another spcola is at work here", path.parent, "wait until it is done"
            ) from error
        yield
