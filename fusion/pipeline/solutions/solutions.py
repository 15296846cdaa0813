"""Solutions of a workspace: listed, chosen and removed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fusion.pipeline.solutions.folder import changing
from fusion.workspace import IMPORTED, Workspace
from fusion.workspace.solution_records import (
    SolutionRecord,
    check_name,
    derived_names,
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

    def of_job(self, job: str) -> SolutionRecord | None:
        """Return the one that a job of the service made before its worker was lost.

        Parameters
        ----------
        job : str
            The fact of that name in the record; none if empty.
        """
        return next((one for one in self.records if job and one.facts.get("job") == job), None)


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


def new_name(workspace: Workspace, name: str, stem: str) -> str:
    """Return the name of a new solution: `name`, or the first of ``stem-1``, ``stem-2``, … free.

    Raises
    ------
    WorkspaceError
        If a solution has that name, or it is not allowed: before any work is done.
    """
    taken, number = set(derived_names(workspace.root)), 1
    if name:
        check_name(name)
        if name in taken:
            home = replace(workspace, solution=name).home
            raise WorkspaceError(
                f"there is a solution {name!r} already", home, "name another: --as"
            )
        return name
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
