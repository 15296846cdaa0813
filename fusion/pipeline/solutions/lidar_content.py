"""Whether the maplets of a solution contain the lidar already, so that it would count twice."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Self

from fusion.estimation.verdict import Code, Finding, Severity
from fusion.pipeline.solutions.solutions import lineage
from fusion.workspace import Workspace
from fusion.workspace.solution_records import SolutionRecord

__all__ = ["LidarContent"]

# Fact of the record of an exported solution, and of the imported one of a workspace made of it.
_FACT = "lidar_in_maplets"
# Constraints of ``spc lithos`` that are lidar heights, and those of other maplets of the parent.
_OF_LIDAR = frozenset({"lidar", "returns"})
_OF_MAPLETS = frozenset({"overlaps", "coarser"})
# Outcomes with which a maplet keeps the heights of the parent.
_KEEPS = frozenset({"too-few-images", "diverged"})
_ELSEWHERE = "the workspace from which it was exported, and a solution without it there"


class LidarContent(NamedTuple):
    """How the lidar came into the maplets of a solution.

    Attributes
    ----------
    solution, made_by : str
        The first solution whose maplets contain it, and the command that made this one.
    without : str
        The solution from which that was made: its maplets do not contain the lidar. Empty if the
        workspace does not have it, as an exported solution was imported.
    """

    solution: str
    made_by: str
    without: str

    @classmethod
    def of(cls, workspace: Workspace) -> Self | None:
        """Return it; None if the maplets of the workspace's solution do not contain the lidar.

        The records of the solution and of those from which it was made show it: maplets that were
        solved with heights of mapolas or returns, mapolas that became maplets, and all that was
        made of these, but for maplets that were all solved anew from the shape without them. One
        such maplet is enough.

        Raises
        ------
        WorkspaceError
            If the record of one of these solutions is gone or damaged.
        """
        found = None
        for record in lineage(workspace):
            if stated := _facts(record, _FACT):
                found = cls(str(stated["solution"]), str(stated["made_by"]), "")
            elif _adds(record):
                found = cls(record.name, record.made_by, record.parent)
            elif _replaces(record):
                break
        return found

    @property
    def text(self) -> str:
        """What was found, in one clause."""
        return f"the maplets contain the lidar (solution {self.solution}, by {self.made_by})"

    @property
    def facts(self) -> dict[str, Any]:
        """The fact by which an exported solution states it."""
        return {_FACT: {"solution": self.solution, "made_by": self.made_by}}

    @property
    def finding(self) -> Finding:
        """About a result in which the lidar counts twice, as the user accepts."""
        text = f"{self.text}: it counts twice, so that sigmas and differences are too small"
        return Finding(Code.LIDAR_COUNTED_TWICE, Severity.DOUBTFUL, text)

    def obstacle(self, workspace: Workspace, accepted: Collection[str]) -> str:
        """Return why the lidar may not be used with these maplets, and what to do.

        Parameters
        ----------
        workspace : Workspace
        accepted : collection of str
            Codes of findings that the user accepts.

        Returns
        -------
        str
            Empty if that is accepted.
        """
        if Code.LIDAR_COUNTED_TWICE in accepted:
            return ""
        other = f"the solution without it, spcola solution use {workspace.root} {self.without}"
        return (
            f"{self.text}, which would count twice; use {other if self.without else _ELSEWHERE}, "
            f"or accept the code {Code.LIDAR_COUNTED_TWICE} (--accept, [accept] codes)"
        )


def _adds(record: SolutionRecord) -> bool:
    """Return whether a solution has maplets that were solved with lidar heights, or are these."""
    return bool(_OF_LIDAR & _constraints(record)) or _facts(record, "albedo").get("of") == "mapolas"


def _replaces(record: SolutionRecord) -> bool:
    """Return whether all maplets of a solution were solved anew, without those of its parent."""
    own = _facts(record, "lithos")
    whole = own.get("only") == [] and own.get("within", "") is None
    kept = _KEEPS & set(_facts(record, "outcomes"))
    anew = own.get("start") == "shape" and not _OF_MAPLETS & _constraints(record)
    return bool(_facts(record, "outcomes")) and whole and anew and not kept


def _constraints(record: SolutionRecord) -> set[str]:
    """Return the kinds of heights with which the maplets of a solution were solved."""
    return {str(kind) for kind in _facts(record, "lithos").get("constraints") or ()}


def _facts(record: SolutionRecord, name: str) -> Mapping[str, Any]:
    """Return a table of the facts of a record; an empty one if it has none of that name."""
    found = record.facts.get(name)
    return found if isinstance(found, Mapping) else {}
