"""Solutions of a workspace: made from one another, chosen, exported and removed."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import spcola
from fusion.runtime.folders import (
    clear_abandoned_folders,
    clear_leftovers,
    locked,
    make_folder,
)
from fusion.workspace import IMPORTED, SPC_FOLDERS, SPC_LISTS, Workspace
from fusion.workspace.solution_records import (
    SolutionRecord,
    check_name,
    derived_names,
    name_in_use,
    read_solution,
    solution_folder,
    write_name_in_use,
    write_solution,
)
from spcola import atomic
from spcola.errors import WorkspaceError
from spcola.formats.solution.exact_camera import StoredCamera, exact_cameras

LOCK_FILE = ".lock"
# Pixels belong to the workspace, and all solutions share them.
_FOLDERS = tuple(name for name in SPC_FOLDERS if name != "IMAGEFILES")


@dataclass(frozen=True)
class MadeBy:
    """What makes a solution, for its record.

    Parameters
    ----------
    command : str
        Such as "spcola scale --apply".
    constants : mapping of str to mapping
        What it changes of the settings, by table.
    facts : mapping
        Numbers of the change, in JSON types.
    digests : mapping of str to str
        SHA-256 of the files from which the change comes.
    """

    command: str
    constants: Mapping[str, Mapping[str, Any]]
    facts: Mapping[str, Any]
    digests: Mapping[str, str]


def solutions_of(workspace: Workspace) -> list[SolutionRecord]:
    """Return the records of all solutions, each after its parent; the imported one first."""
    root = workspace.root
    records = [read_solution(root, name) for name in (IMPORTED, *derived_names(root))]
    ordered: list[SolutionRecord] = []
    waiting = [one for one in records if one.parent not in {each.name for each in records}]
    while waiting:
        one = waiting.pop(0)
        ordered.append(one)
        waiting = [each for each in records if each.parent == one.name] + waiting
    return ordered


def free_name(workspace: Workspace, stem: str) -> str:
    """Return the first of ``stem-1``, ``stem-2``, … that no solution has."""
    taken, number = set(derived_names(workspace.root)), 1
    while f"{stem}-{number}" in taken:
        number += 1
    return f"{stem}-{number}"


@contextmanager
def making_solution(workspace: Workspace, name: str, made_by: MadeBy) -> Iterator[Path]:
    """Make a solution from that of a workspace: whole, or not at all.

    The block writes into the folder that is yielded what differs from the parent's files, under
    their names. All other files of the parent are linked then, not copied. Afterwards the folder
    gets its record and its name.

    Parameters
    ----------
    workspace : Workspace
        Its solution is the parent.
    name : str
    made_by : MadeBy

    Raises
    ------
    WorkspaceError
        If the name is taken or not allowed, or the solution cannot be written.
    """
    check_name(name)
    folder = solution_folder(workspace.root, name)
    make_folder(folder.parent)
    with locked(folder.parent / LOCK_FILE):
        clear_leftovers([folder.parent])
        if folder.exists():
            raise WorkspaceError(f"there is a solution {name!r} already", folder, "name another")
        making = folder.with_name(f".{name}.part")
        try:
            for each in _FOLDERS:
                make_folder(making / each)
            begun = time.process_time()
            yield making
            effort = {
                "items": sum(len(_files(making / each)) for each in _FOLDERS),
                "processor_s": time.process_time() - begun,
            }
            _link_unchanged(workspace, making)
            # The time has no place in digests of results: only the record has it.
            made = datetime.now(UTC).isoformat(timespec="seconds")
            record = SolutionRecord(
                name, workspace.solution, made_by.command, made, spcola.__version__,
                made_by.constants, made_by.facts, made_by.digests, effort,
            )  # fmt: skip
            write_solution(making, record)
            making.rename(folder)
        except OSError as error:
            raise atomic.write_error(folder, error) from error
        finally:
            shutil.rmtree(making, ignore_errors=True)


def use_solution(workspace: Workspace, name: str) -> Workspace:
    """Let all stages and commands read a solution from now on.

    Raises
    ------
    WorkspaceError
        If there is no such solution.
    """
    read_solution(workspace.root, name)
    write_name_in_use(workspace.root, name)
    return replace(workspace, solution=name)


def remove_solution(workspace: Workspace, name: str) -> None:
    """Remove a solution, and all that was made with it.

    Raises
    ------
    WorkspaceError
        If it is the imported one or the one in use, another was made from it, or another program
        works with it.
    """
    root = workspace.root
    read_solution(root, name)
    if name == IMPORTED:
        raise WorkspaceError("the imported solution cannot be removed", root)
    if name == name_in_use(root):
        raise WorkspaceError(
            f"the solution {name!r} is in use", root, "use another one first: spcola solution use"
        )
    children = [one.name for one in solutions_of(workspace) if one.parent == name]
    if children:
        raise WorkspaceError(
            f"the solution {name!r} cannot be removed: {', '.join(children)} "
            f"{'was' if len(children) == 1 else 'were'} made from it",
            root,
            "remove these first",
        )
    folder = solution_folder(root, name)
    with locked(folder.parent / LOCK_FILE), locked(folder / LOCK_FILE):
        # Out of sight at once: a crash leaves no half of it under its name.
        gone = folder.with_name(f".{name}.part")
        folder.rename(gone)
        shutil.rmtree(gone, ignore_errors=True)


def export_solution(
    workspace: Workspace, folder: Path
) -> tuple[dict[str, int], dict[str, StoredCamera]]:
    """Write the solution of a workspace as a plain SPC folder, with the pixels of its images.

    Parameters
    ----------
    workspace : Workspace
    folder : Path
        Made; it must not exist.

    Returns
    -------
    counts : dict of str to int
        Number of files in each folder.
    cameras : dict of str to StoredCamera
        Exact cameras to which .SUM files have only a fit, by their files.

    Raises
    ------
    WorkspaceError
        If the folder exists or cannot be written.
    FormatError
        If the exact camera of an image is missing or damaged.
    """
    if folder.exists() or folder.is_symlink():
        raise WorkspaceError("exists already", folder, "name a folder that does not exist")
    clear_abandoned_folders(folder)
    making = folder.with_name(f".{folder.name}.{os.getpid()}")
    files = {**solution_files(workspace), "IMAGEFILES": _files(workspace.root / "IMAGEFILES")}
    cameras = exact_cameras(path for path in files["SUMFILES"] if path.suffix == ".SUM")
    try:
        for name, paths in files.items():
            make_folder(making / name)
            for path in paths:
                shutil.copyfile(path, making / name / path.name)
        write_solution(making, read_solution(workspace.root, workspace.solution))
        making.rename(folder)
    except OSError as error:
        raise atomic.write_error(folder, error) from error
    finally:
        shutil.rmtree(making, ignore_errors=True)
    return {name: len(paths) for name, paths in files.items() if name}, cameras


def solution_files(workspace: Workspace) -> dict[str, list[Path]]:
    """Return the files of the solution of a workspace, by folder; its lists are in ``""``."""
    found = {name: _files(workspace.home / name) for name in _FOLDERS}
    return {**found, "": [p for name in SPC_LISTS if (p := workspace.home / name).is_file()]}


def _files(folder: Path) -> list[Path]:
    """Return the visible files of a folder in the order of their names; none without a folder."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_file() and path.name[0] != ".")


def _link_unchanged(workspace: Workspace, folder: Path) -> None:
    """Link the parent's files that a new solution does not have; copied where links fail."""
    for name, paths in solution_files(workspace).items():
        for path in paths:
            target = folder / name / path.name
            if target.exists():
                continue
            try:
                # A link in the folder itself would be linked, not the file that it leads to.
                os.link(path.resolve(), target)
            except OSError:
                shutil.copyfile(path, target)
