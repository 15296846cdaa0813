"""Where the state of the service, and its workspaces, lie in its folder."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from fusion.workspace import SETTINGS_FILE

__all__ = [
    "STATE_FOLDER",
    "STORE_NAME",
    "WORKSPACE_NAME",
    "cache_folder",
    "logs_folder",
    "outputs_folder",
    "uploads_folder",
    "visible_file",
    "workspace_place",
]

STATE_FOLDER = ".service"
STORE_NAME = "store.sqlite"
WORKSPACE_NAME = r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
"""What the name of a workspace looks like."""


def workspace_place(folder: Path, name: str) -> Path | None:
    """Return where a workspace lies in the folder of the service, or may be made; None if nowhere.

    Parameters
    ----------
    folder : Path
        A workspace, or a folder whose sub-folders are workspaces.
    name : str
    """
    if (folder / SETTINGS_FILE).is_file():
        return folder if name == folder.name else None
    return folder / name if re.fullmatch(WORKSPACE_NAME, name) else None


def uploads_folder(folder: Path) -> Path:
    """Return where uploads lie, each in a folder of its id."""
    return folder / STATE_FOLDER / "uploads"


def cache_folder(folder: Path) -> Path:
    """Return where views are kept that took long to make; they can be removed at any time."""
    return folder / STATE_FOLDER / "cache"


def outputs_folder(folder: Path, workspace: str) -> Path:
    """Return where jobs in a workspace write what is not a part of it."""
    return folder / STATE_FOLDER / "outputs" / workspace


def visible_file(root: Path, name: str) -> Path | None:
    """Return the path of what lies below a folder, resolved.

    None if there is nothing of this name, it or a folder in it begins with a dot, or a link leads
    out of the folder.
    """
    parts = PurePosixPath(name).parts
    if not parts or any(part.startswith((".", "/")) or "\0" in part for part in parts):
        return None
    try:
        path = root.joinpath(*parts).resolve(strict=True)
        inside = path.relative_to(root.resolve()).parts
    except (OSError, RuntimeError, ValueError):
        return None
    return None if any(part.startswith(".") for part in inside) else path


def logs_folder(folder: Path) -> Path:
    """Return where the processes of the service write their logs."""
    return folder / STATE_FOLDER / "logs"
