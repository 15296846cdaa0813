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
from fusion.service.work.spc_folder import EXPORT_RECORD, spc_place
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.solution_records import read_record
from spcola.atomic import replacing
from spcola.errors import InvalidValueError, WorkspaceError
from spcola.formats.maplets import read_maplet
from spcola.formats.solution import read_landmark, read_summary

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
        If a name is that of no SPC file, or the workspace exists with another shape or other
        constants than given.
    FormatError
        If a file does not have the content of its format.
    WorkspaceError
        If another file is there already.
    """
    records = [path for path in files if path.name == EXPORT_RECORD]
    places = {path: spc_place(path.name) for path in files if path not in records}
    if (root / SETTINGS_FILE).is_file():
        made = Workspace.open(root)
        # A worker that was lost may have made it from the same files.
        if not _is_made_from(made, given, shape, records):
            what = f"exists: another shape or {EXPORT_RECORD} is given when it is made"
            raise InvalidValueError(what, "workspace")
    else:
        made = new_workspace(
            root,
            body=given.body,
            shape=shape,
            shape_unit=given.shape_unit,
            faces_from=given.faces_from,
            exported=records[0].parent if records else None,
        )
    with progress.task("files", len(places)) as task:
        for _ in executor.stream(_Placing(root, places), list(places)):
            task.advance()
    return describe_workspace(made)


def _is_made_from(
    made: Workspace, given: InitParameters, shape: Path | None, records: Sequence[Path]
) -> bool:
    """Return whether a workspace has the shape and the constants that are given."""
    settings = made.settings()
    for record in records:
        if settings.with_tables(read_record(record.parent).constants, record) != settings:
            return False
    if shape is None:
        return True
    body, there = settings.body, made.root / "SHAPEFILES" / shape.name
    wanted = (given.body, shape.name, given.shape_unit, given.faces_from)
    return (
        (body.name, body.shape, body.shape_unit, body.faces_from) == wanted
        and there.is_file()
        and filecmp.cmp(shape, there, shallow=False)
    )


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
