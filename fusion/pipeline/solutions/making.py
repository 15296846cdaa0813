"""A solution is made from another: whole, or not at all."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import spcola
from fusion.pipeline.solutions.folder import changing, part_of
from fusion.runtime.folders import LOCK_FILE, locked, make_folder
from fusion.workspace import SPC_FOLDERS, SPC_LISTS, Workspace, visible_files
from fusion.workspace.solution_records import (
    SolutionRecord,
    check_name,
    read_solution,
    solution_folder,
    write_record,
)
from spcola.atomic import write_error
from spcola.errors import WorkspaceError

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
        Numbers of the change, in JSON types; read when the solution is complete.
    digests : mapping of str to str
        SHA-256 of the files from which the change comes.
    settings : mapping of str to mapping
        Settings with which it was computed, by table.
    """

    command: str
    constants: Mapping[str, Mapping[str, Any]]
    facts: Mapping[str, Any]
    digests: Mapping[str, str]
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@contextmanager
def making_solution(
    workspace: Workspace, name: str, made_by: MadeBy, *, without: Collection[str] = frozenset()
) -> Iterator[Path]:
    """Make a solution from that of a workspace: whole, or not at all.

    The block writes into the folder that is yielded what differs from the parent's files, under
    their names. All other files of the parent are linked then, not copied. Afterwards the folder
    gets its record and its name. Meanwhile other solutions may be made, but the parent is not
    removed.

    Parameters
    ----------
    workspace : Workspace
        Its solution is the parent.
    name : str
    made_by : MadeBy
    without : collection of str
        Files of the parent that the solution does not have, such as ``MAPFILES/AB0001.MAP``.

    Raises
    ------
    WorkspaceError
        If the name is taken or not allowed, or the solution cannot be written.
    SettingsError
        If a constant is unknown or not allowed.
    """
    check_name(name)
    workspace.settings().with_tables(made_by.constants, made_by.command)
    record = SolutionRecord(name, workspace.solution, made_by.command, "", spcola.__version__,
                            made_by.constants, made_by.facts, made_by.digests,
                            settings=made_by.settings)  # fmt: skip
    with _begun(workspace, record) as making:
        started = time.process_time()
        yield making
        effort = {
            "items": sum(len(visible_files(making / each)) for each in _FOLDERS),
            "processor_s": time.process_time() - started,
        }
        _link_unchanged(workspace, making, without)
        # The time has no place in digests of results: only the record has it.
        made = datetime.now(UTC).isoformat(timespec="seconds")
        write_record(making, replace(record, made=made, effort=effort))
        folder = solution_folder(workspace.root, name)
        with changing(workspace.root):
            try:
                making.rename(folder)
            except OSError as error:
                raise write_error(folder, error) from error


@contextmanager
def _begun(workspace: Workspace, record: SolutionRecord) -> Iterator[Path]:
    """Yield the locked, hidden folder of a new solution; removed at the end if it has no name."""
    folder = solution_folder(workspace.root, record.name)
    making = part_of(folder)
    with ExitStack() as stack:
        with changing(workspace.root):
            if folder.exists() or folder.is_symlink():
                raise WorkspaceError(
                    f"there is a solution {record.name!r} already", folder, "name another"
                )
            if making.exists():
                raise WorkspaceError(
                    f"another spcola is making the solution {record.name!r}", folder, "name another"
                )
            # Another program may have removed the parent.
            read_solution(workspace.root, workspace.solution)
            make_folder(making)
            stack.enter_context(locked(making / LOCK_FILE))
            stack.callback(shutil.rmtree, making, ignore_errors=True)
            for each in _FOLDERS:
                make_folder(making / each)
            write_record(making, record)
        yield making


def solution_files(workspace: Workspace) -> dict[str, list[Path]]:
    """Return the files of the solution of a workspace, by folder; its lists are in ``""``.

    Raises
    ------
    WorkspaceError
        If a folder cannot be listed, or a link in it leads nowhere.
    """
    # Lists first: a program that adds a file lists it afterwards.
    lists = [path for name in SPC_LISTS if (path := workspace.home / name).is_file()]
    return {"": lists, **{name: visible_files(workspace.home / name) for name in _FOLDERS}}


def _link_unchanged(workspace: Workspace, folder: Path, without: Collection[str]) -> None:
    """Link the parent's files that a new solution does not have; copied where links fail."""
    for name, paths in solution_files(workspace).items():
        for path in paths:
            target = folder / name / path.name
            if target.exists() or f"{name}/{path.name}" in without:
                continue
            try:
                # A link in the folder itself would be linked, not the file that it leads to.
                os.link(path.resolve(), target)
            except OSError:
                copy(path, target)


def copy(source: Path, target: Path) -> None:
    """Copy the content of a file.

    Raises
    ------
    WorkspaceError
        If one cannot be read, or the other not be written.
    """
    try:
        shutil.copyfile(source, target)
    except FileNotFoundError as error:
        raise WorkspaceError("was removed meanwhile", source, "run the command again") from error
    except OSError as error:
        raise write_error(target, error) from error
