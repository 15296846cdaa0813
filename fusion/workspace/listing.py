"""Names of the files in the folders of a workspace."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from spcola.errors import WorkspaceError
from spcola.formats.solution import read_list


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
        If it cannot be listed. A link that leads nowhere, and a folder with the `suffix` of a
        file, are refused: what they stand for would be left out silently.
    """
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.name[0] != ".")
        for entry in entries:
            if entry.is_symlink() and not entry.exists():
                raise WorkspaceError(
                    f"is a link to {entry.readlink()}, which is not there",
                    entry,
                    "bring that back, or remove the link",
                )
            if suffix and entry.suffix == suffix and not entry.is_file():
                raise WorkspaceError("is no file", entry, "move it elsewhere")
        files = [entry for entry in entries if entry.is_file()]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise WorkspaceError(
            f"cannot be listed ({error.strerror})", folder, "check its permissions"
        ) from error
    return [file for file in files if file.suffix == suffix] if suffix else files


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
        return [file.stem for file in visible_files(there, suffix)]
    names = read_list(listing, kind=kind)
    if not names and (files := visible_files(there, suffix)):
        raise WorkspaceError(
            f"lists nothing, but {folder} holds {len(files)} files",
            listing,
            "write their names into it, or remove it to take all of them",
        )
    return names


def is_there(path: Path) -> bool:
    """Return whether this path exists, even as a link that leads nowhere."""
    return path.exists() or path.is_symlink()
