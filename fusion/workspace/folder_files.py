"""Files of a folder of the workspace."""

from __future__ import annotations

import os
from pathlib import Path

from spcola.errors import WorkspaceError


def visible_files(folder: Path, suffix: str = "") -> list[str]:
    """Return the names of the visible files of a folder, sorted; none where there is no folder.

    Raises
    ------
    WorkspaceError
        If the folder cannot be listed; for a link that leads nowhere, and a folder with the
        `suffix` of a file: what they stand for would be left out silently.
    """
    names = []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name[0] == ".":
                    continue
                # Not entry.is_file() of a link: it fails if that leads in a circle.
                if Path(entry.path).is_file() if entry.is_symlink() else entry.is_file():
                    names.append(entry.name)
                else:
                    _check(entry, suffix)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise WorkspaceError(
            f"cannot be listed ({error.strerror})", folder, "check its permissions"
        ) from error
    return sorted(names)


def _check(entry: os.DirEntry[str], suffix: str) -> None:
    """Refuse an entry that is no file but stands for one."""
    path = Path(entry.path)
    if entry.is_symlink() and not path.exists():
        raise WorkspaceError(
            f"is a link to {path.readlink()}, which is not there",
            path,
            "bring that back, or remove the link",
        )
    if suffix and path.suffix == suffix:
        raise WorkspaceError("is no file", path, "move it elsewhere")
