"""SPC files that are sent to the service, and where each belongs in a workspace."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fusion.workspace import SPC_LISTS, spc_files
from spcola.errors import InvalidValueError, WorkspaceError

__all__ = ["EXPORT_RECORD", "sent_files", "spc_place"]

# What `spcola solution export` writes next to the SPC files.
EXPORT_RECORD = "solution.json"
_FOLDERS: Mapping[str, str] = {
    ".MAP": "MAPFILES",
    ".SIG": "MAPFILES",
    ".ASG": "MAPFILES",
    ".SSG": "MAPFILES",
    ".SDR": "MAPFILES",
    ".LMK": "LMKFILES",
    ".SUM": "SUMFILES",
    ".NOM": "NOMINALS",
    ".DAT": "IMAGEFILES",
}


def sent_files(folder: Path) -> tuple[list[Path], Path | None]:
    """Return the files of an SPC working folder that a job makes a workspace of, and its shape.

    If a workspace exported the folder, its ``solution.json`` is one of them: its body constants
    are taken.

    Raises
    ------
    WorkspaceError
        If it is no SPC working folder, or has several shapes of which none is SHAPE.TXT.
    InvalidValueError
        If a file has no place in a workspace.
    """
    files: list[Path] = []
    shapes: list[Path] = []
    for path, place in spc_files(folder):
        (shapes if place.startswith("SHAPEFILES/") else files).append(path)
    for path in files:
        spc_place(path.name)
    named = [path for path in shapes if path.name == "SHAPE.TXT"]
    if len(shapes) > 1 and not named:
        names = ", ".join(path.name for path in shapes)
        raise WorkspaceError(
            f"has several shapes ({names})",
            folder / "SHAPEFILES",
            "leave one, or name it SHAPE.TXT",
        )
    record = folder / EXPORT_RECORD
    return files + ([record] if record.is_file() else []), next(iter(named or shapes), None)


def spc_place(name: str) -> str:
    """Return where an SPC file of this name lies in a workspace.

    Raises
    ------
    InvalidValueError
        If it is the name of no SPC file.
    """
    if name in SPC_LISTS:
        return name
    stem, dot, suffix = name.rpartition(".")
    folder = _FOLDERS.get(f".{suffix}") if stem and dot else None
    if folder is None:
        known = ", ".join((*_FOLDERS, *SPC_LISTS))
        raise InvalidValueError("is not the name of an SPC file", name, f"known are {known}")
    return f"{folder}/{name}"
