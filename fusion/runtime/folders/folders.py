"""Folders made and removed; what killed programs left in them."""

from __future__ import annotations

import glob
import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from fusion.runtime.folders.lock import LOCK_FILE, is_locked
from spcola.errors import WorkspaceError


def make_folder(path: Path) -> None:
    """Create a folder and those above it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    WorkspaceError
        If it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkspaceError(
            f"cannot be created ({error.strerror})", path, "check the folder above it"
        ) from error


def clear_leftovers(folders: Iterable[Path]) -> None:
    """Remove incomplete files of a killed program in `folders`; call it under the lock.

    A folder whose lock file another program has locked remains.
    """
    for folder in folders:
        for left in folder.glob(".*.part"):
            if left.is_symlink() or not left.is_dir():
                left.unlink(missing_ok=True)
            elif not is_locked(left / LOCK_FILE):
                shutil.rmtree(left, ignore_errors=True)


def clear_abandoned_folders(folder: Path) -> None:
    """Remove the hidden folders ``.NAME.PID`` next to `folder` whose process has ended."""
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.*"):
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
