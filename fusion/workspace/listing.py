"""Names of the files in the folders of a workspace."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from spcola.errors import WorkspaceError
from spcola.formats.solution import read_list


def visible_names(folder: Path, suffix: str = "") -> list[str]:
    """Return the names of the visible files of a folder, sorted; none where there is no folder.

    Parameters
    ----------
    folder : Path
    suffix : str
        Such as ".MAP": only these; by default all.

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
    return sorted(name for name in names if name.endswith(suffix))


def visible_files(folder: Path, suffix: str = "") -> list[Path]:
    """Return the visible files of a folder, sorted; none where there is no folder.

    Parameters
    ----------
    folder : Path
    suffix : str
        Such as ".MAP": only these; by default all.

    Raises
    ------
    WorkspaceError
        See :func:`visible_names`.
    """
    return [folder / name for name in visible_names(folder, suffix)]


def entry_names(folder: Path) -> frozenset[str]:
    """Return the names of all that is in a folder; none where there is no folder."""
    return frozenset(path.name for path in folder.iterdir()) if folder.is_dir() else frozenset()


def listed_names(
    listing: Path, kind: Literal["image", "landmark"], folder: str, suffix: str
) -> list[str]:
    """Return the names in a list, or all in a folder if there is no list.

    Parameters
    ----------
    listing : Path
        Such as PICTLIST.TXT.
    kind : {"image", "landmark"}
        What it lists.
    folder, suffix : str
        Where the files of these names are, next to the list.

    Raises
    ------
    WorkspaceError
        If it lists nothing, but the folder has files.
    """
    there = listing.parent / folder
    if not is_there(listing):
        return [name.removesuffix(suffix) for name in visible_names(there, suffix)]
    names = read_list(listing, kind=kind)
    if not names and (files := visible_names(there, suffix)):
        raise WorkspaceError(
            f"lists nothing, but {folder} holds {len(files)} files",
            listing,
            "write their names into it, or remove it to take all of them",
        )
    return names


def is_there(path: Path) -> bool:
    """Return whether this path exists, even as a link that leads nowhere."""
    return path.exists() or path.is_symlink()


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
