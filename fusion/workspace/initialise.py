"""Make a workspace: empty, from a shape, or over an SPC working folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Literal

from fusion.runtime.folders import make_folder
from fusion.workspace.settings.inputs import BodySettings
from fusion.workspace.settings.settings import Settings
from fusion.workspace.solution_records.record import SOLUTION_FILE, read_record
from fusion.workspace.workspace import SETTINGS_FILE, SPC_FOLDERS, SPC_LISTS, Workspace
from spcola.atomic import replacing, write_error
from spcola.errors import WorkspaceError
from spcola.formats.shapes import read_shape


def new_workspace(
    root: Path,
    *,
    body: str = "body",
    spc: Path | None = None,
    shape: Path | None = None,
    shape_unit: Literal["km", "m"] = "km",
    faces_from: Literal[1, 0] = 1,
    exported: Path | None = None,
) -> Workspace:
    """Make `root` a workspace; existing files are unchanged.

    Parameters
    ----------
    body : str
        Name of the body.
    spc : Path, optional
        An SPC working folder. Its files are linked (a new solution there is then used here), or
        copied if the file system has no links. If it is `root`, nothing is done.
    shape : Path, optional
        A shape model; it is read once as a check, and copied.
    shape_unit : {"km", "m"}
        Of an OBJ or PLY shape.
    faces_from : {1, 0}
        The number by which the faces of an OBJ name its first vertex.
    exported : Path, optional
        Where the ``solution.json`` of an exported solution is, whose body constants are taken, and
        what it states of the maplets; by default `spc`, if there is one.

    Raises
    ------
    WorkspaceError
        If `root` is a workspace already, or `spc` is no SPC folder, or its ``solution.json`` is
        damaged.
    FormatError
        If `shape` is no shape model.
    SettingsError
        If `body` is no name in ASCII.
    """
    if (root / SETTINGS_FILE).exists():
        raise WorkspaceError("is a workspace already", root, f"edit its {SETTINGS_FILE}")
    given = {
        "name": body,
        "shape": "" if shape is None else shape.name,
        "shape_unit": shape_unit,
        "faces_from": faces_from,
    }
    plain = BodySettings().model_dump()
    given = {key: value for key, value in given.items() if value != plain[key]}
    record = _record_of(exported or spc)
    settings = _exported(record).with_table("body", **given)
    if shape is not None:
        read_shape(shape, unit=shape_unit, faces_from=faces_from)
    linked = [] if spc is None or _same(spc, root) else spc_files(spc)
    for source, place in linked:
        make_folder((root / place).parent)
        _link(source, root / place)
    if shape is not None and not _same(shape.parent, root / "SHAPEFILES"):
        make_folder(root / "SHAPEFILES")
        with replacing(root / "SHAPEFILES" / shape.name) as temporary:
            shutil.copyfile(shape, temporary)
    if record is not None and not _same(record, root / SOLUTION_FILE):
        make_folder(root)
        with replacing(root / SOLUTION_FILE) as temporary:
            shutil.copyfile(record, temporary)
    # The settings last: a folder that has them has all that was given.
    return Workspace.create(root, settings)


def spc_files(folder: Path) -> list[tuple[Path, str]]:
    """Return the files of an SPC working folder, each with its place in a workspace.

    Raises
    ------
    WorkspaceError
        If `folder` has none of the SPC folders (MAPFILES, SUMFILES, …).
    """
    try:
        inside = [
            (entry, f"{name}/{entry.name}")
            for name in SPC_FOLDERS
            if (folder / name).is_dir()
            for entry in sorted((folder / name).iterdir())
            if not entry.name.startswith(".") and (entry.is_file() or entry.is_symlink())
        ]
    except OSError as error:
        raise WorkspaceError(f"cannot be listed ({error.strerror})", folder) from error
    if not any((folder / name).is_dir() for name in SPC_FOLDERS):
        raise WorkspaceError(
            "is no SPC working folder", folder, f"it should have some of {', '.join(SPC_FOLDERS)}"
        )
    inside += [(folder / name, name) for name in SPC_LISTS if (folder / name).is_file()]
    for entry, _ in inside:
        if not entry.exists():
            raise WorkspaceError(
                "is a link that leads nowhere", entry, "bring its file back, or remove the link"
            )
    return inside


def _record_of(folder: Path | None) -> Path | None:
    """Return the file with the record of the solution that was exported to a folder, if any."""
    path = None if folder is None else folder / SOLUTION_FILE
    return path if path is not None and path.is_file() else None


def _exported(record: Path | None) -> Settings:
    """Return the default settings with the constants of an exported solution."""
    if record is None:
        return Settings()
    return Settings().with_tables(read_record(record.parent).constants, record)


def _link(source: Path, target: Path) -> None:
    """Link `target` to `source`, or copy if links cannot be made; another file is refused."""
    if target.is_symlink() and target.readlink() == source.resolve():
        return
    if target.exists() or target.is_symlink():
        raise WorkspaceError("exists already", target, "choose another folder for the workspace")
    try:
        target.symlink_to(source.resolve())
    except OSError:
        try:
            with replacing(target) as temporary:
                shutil.copyfile(source, temporary)
        except OSError as error:
            raise write_error(target, error) from error


def _same(one: Path, other: Path) -> bool:
    """Return whether two paths name one folder."""
    return one.exists() and other.exists() and one.samefile(other)
