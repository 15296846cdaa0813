"""One program at a time in a folder; temporary files of a killed one are removed."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
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


def clear_leftovers(folders: Iterable[Path]) -> None:
    """Remove incomplete files of a killed program in `folders`; call it under the lock."""
    for folder in folders:
        for left in folder.glob(".*.part"):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def clear_abandoned_folders(folder: Path) -> None:
    """Remove the hidden folders ``.NAME.PID`` next to `folder` whose process has ended."""
    for left in folder.parent.glob(f".{folder.name}.*"):
        number = left.suffix[1:]
        if left.is_dir() and number.isdecimal() and not _runs(int(number)):
            shutil.rmtree(left, ignore_errors=True)


def _runs(process: int) -> bool:
    """Return whether there is a process of this number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def remove_folder(folder: Path) -> None:
    """Remove a folder, and the one that it lies in if nothing else is left there."""
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(OSError):
        folder.parent.rmdir()
