"""A workspace from uploaded files: a shape, or the files of an SPC solution."""

from __future__ import annotations

import filecmp
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.inspection import describe_workspace
from fusion.runtime import Executor, Progress
from fusion.service.work.parameters import InitParameters
from fusion.workspace import SETTINGS_FILE, SPC_LISTS, Workspace, new_workspace
from spcola.atomic import replacing
from spcola.errors import InvalidValueError, WorkspaceError
from spcola.formats.maplets import read_maplet
from spcola.formats.solution import read_landmark, read_summary

__all__ = ["begin_workspace", "spc_place"]

_FOLDERS: Mapping[str, str] = {
    ".MAP": "MAPFILES",
    ".SIG": "MAPFILES",
    ".LMK": "LMKFILES",
    ".SUM": "SUMFILES",
    ".NOM": "NOMINALS",
    ".DAT": "IMAGEFILES",
}
_READERS: Mapping[str, Callable[[Path], Any]] = {
    ".MAP": read_maplet,
    ".LMK": read_landmark,
    ".SUM": read_summary,
}


def begin_workspace(
    root: Path,
    given: InitParameters,
    *,
    shape: Path | None,
    files: Sequence[Path],
    executor: Executor,
    progress: Progress,
) -> dict[str, Any]:
    """Make a workspace if there is none, and put SPC files where their names belong.

    Returns
    -------
    dict
        The content of the workspace, as ``spcola init --json`` has it.

    Raises
    ------
    InvalidValueError
        If a name is that of no SPC file, or the workspace exists and a body or shape is given.
    FormatError
        If a file does not have the content of its format.
    WorkspaceError
        If another file is there already.
    """
    places = {path: spc_place(path.name) for path in files}
    if (root / SETTINGS_FILE).is_file():
        if shape is not None:
            raise InvalidValueError("exists: a shape is given when it is made", "workspace")
        made = Workspace.open(root)
    else:
        made = new_workspace(
            root,
            body=given.body,
            shape=shape,
            shape_unit=given.shape_unit,
            faces_from=given.faces_from,
        )
    with progress.task("files", len(places)) as task:
        for _ in executor.stream(_Placing(root, places), list(places)):
            task.advance()
    return describe_workspace(made)


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


@dataclass(frozen=True)
class _Placing:
    """Reads a file as a check, and copies it to its place."""

    root: Path
    places: Mapping[Path, str]

    def __call__(self, path: Path) -> None:
        """Place one file; the same one again changes nothing."""
        target = self.root / self.places[path]
        if reader := _READERS.get(path.suffix):
            reader(path)
        if target.exists():
            if not filecmp.cmp(path, target, shallow=False):
                raise WorkspaceError("is there already, with other content", target)
            return
        with replacing(target) as temporary:
            shutil.copyfile(path, temporary)
