"""Solutions of a workspace: listed, chosen and removed."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace

from fusion.pipeline.solutions.folder import begun, changing, part_of
from fusion.runtime.folders import LOCK_FILE, locked
from fusion.workspace import IMPORTED, Workspace
from fusion.workspace.solution_records import (
    SolutionRecord,
    derived_names,
    name_in_use,
    read_solution,
    write_name_in_use,
)
from spcola.errors import SpcolaError, WorkspaceError

_REMOVE = "remove such solutions: spcola solution remove"


@dataclass(frozen=True)
class Solutions:
    """All solutions of a workspace.

    Attributes
    ----------
    records : tuple of SolutionRecord
        Each after its parent; the imported one first.
    damaged : tuple of SpcolaError
        Why the records of the others cannot be used.
    """

    records: tuple[SolutionRecord, ...]
    damaged: tuple[SpcolaError, ...] = ()

    def sound(self) -> tuple[SolutionRecord, ...]:
        """Return the records.

        Raises
        ------
        SpcolaError
            If one is damaged.
        """
        if self.damaged:
            raise self.damaged[0]
        return self.records


def solutions_of(workspace: Workspace) -> Solutions:
    """Read the records of all solutions of a workspace, and check their constants."""
    root = workspace.root
    records, damaged = list[SolutionRecord](), list[SpcolaError]()
    for name in (IMPORTED, *derived_names(root)):
        try:
            record = read_solution(root, name)
            if name != IMPORTED:
                replace(workspace, solution=name).settings()
            records.append(record)
        except SpcolaError as error:
            damaged.append(error)
    ordered: list[SolutionRecord] = []
    waiting = [one for one in records if one.parent not in {each.name for each in records}]
    while waiting:
        one = waiting.pop(0)
        ordered.append(one)
        waiting = [each for each in records if each.parent == one.name] + waiting
    if circle := [one.name for one in records if one not in ordered]:
        what = f"the parents of {', '.join(circle)} form a circle"
        damaged.append(WorkspaceError(what, root, _REMOVE))
    return Solutions(tuple(ordered), tuple(damaged))


def lineage(workspace: Workspace) -> list[SolutionRecord]:
    """Return the records of the solution of a workspace, its parent, and so on to the imported one.

    Raises
    ------
    WorkspaceError
        If one of them is gone or damaged, or is its own ancestor.
    """
    found = [read_solution(workspace.root, workspace.solution)]
    while found[-1].name != IMPORTED:
        last = found[-1]
        home = replace(workspace, solution=last.name).home
        if last.parent in {one.name for one in found}:
            raise WorkspaceError("its parents form a circle", home, _REMOVE)
        if last.parent not in (IMPORTED, *derived_names(workspace.root)):
            raise WorkspaceError(
                f"its parent {last.parent!r} is gone", home, "bring the folder of that back"
            )
        found.append(read_solution(workspace.root, last.parent))
    return found


def free_name(workspace: Workspace, stem: str) -> str:
    """Return the first of ``stem-1``, ``stem-2``, … that no solution has."""
    taken, number = set(derived_names(workspace.root)), 1
    while f"{stem}-{number}" in taken:
        number += 1
    return f"{stem}-{number}"


def use_solution(workspace: Workspace, name: str) -> Workspace:
    """Let all stages and commands read a solution from now on.

    Raises
    ------
    WorkspaceError
        If there is no such solution, or it is damaged.
    SettingsError
        If its constants are not allowed.
    """
    used = replace(workspace, solution=name)
    with changing(workspace.root):
        # Its constants are checked.
        used.settings()
        write_name_in_use(workspace.root, name)
    return used


def remove_solution(workspace: Workspace, name: str) -> None:
    """Remove a solution, and all that was made with it; also one whose record is damaged.

    Raises
    ------
    WorkspaceError
        If it is the imported one or the one in use, another was made from it, or another program
        works with it.
    """
    root = workspace.root
    if name == IMPORTED:
        raise WorkspaceError("the imported solution cannot be removed", root)
    with changing(root) as folder:
        if name not in derived_names(root):
            read_solution(root, name)
        _check_removable(workspace, name)
        gone = part_of(folder / name)
        try:
            with locked(folder / name / LOCK_FILE):
                # Out of sight at once: a crash leaves no half of it under its name.
                (folder / name).rename(gone)
                if gone.is_symlink():
                    gone.unlink()
                shutil.rmtree(gone, ignore_errors=True)
        except OSError as error:
            raise WorkspaceError(f"cannot be removed ({error.strerror})", folder / name) from error


def _check_removable(workspace: Workspace, name: str) -> None:
    """Refuse to remove what is in use, or from which another solution was made."""
    root = workspace.root
    if name == name_in_use(root):
        raise WorkspaceError(
            f"the solution {name!r} is in use", root, "use another one first: spcola solution use"
        )
    found = solutions_of(workspace)
    children = [one.name for one in (*found.records, *begun(root)) if one.parent == name]
    if children:
        raise WorkspaceError(
            f"the solution {name!r} cannot be removed: {', '.join(children)} "
            f"{'was' if len(children) == 1 else 'were'} made from it",
            root,
            "remove these first",
        )
    if found.damaged and name in {one.name for one in found.records}:
        # What a damaged one was made from is not known.
        raise found.damaged[0]
