"""What a command found that made a solution: the content of its file, and lines for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

from fusion.workspace import Workspace


@dataclass(frozen=True)
class SolutionResult:
    """A new solution, and what was found.

    Attributes
    ----------
    solution, parent : str
    folder : Path
    content : mapping
        Of its file, in JSON types.
    """

    solution: str
    parent: str
    folder: Path
    content: Mapping[str, Any]

    @classmethod
    def read(cls, workspace: Workspace, name: str, parent: str, file: str) -> Self:
        """Return what a solution's file has.

        Parameters
        ----------
        workspace : Workspace
        name, parent : str
            Of the solution, and of that from which it was made.
        file : str
            Its name, in the solution's folder.

        Raises
        ------
        WorkspaceError
            If it cannot be read.
        """
        made = replace(workspace, solution=name)
        return cls(name, parent, made.home, made.read_json(file))

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``--json``."""
        return {"solution": self.solution, "parent": self.parent, **self.content}

    @property
    def counts(self) -> str:
        """How many there are of each outcome, for a printed line."""
        return ", ".join(f"{n} {outcome}" for outcome, n in self.content["outcomes"].items())


def counted(kinds: Iterable[StrEnum]) -> dict[str, int]:
    """Return how many there are of each outcome or fit, sorted, in JSON types."""
    return dict(sorted(Counter(map(str, kinds)).items()))


def use_line(folder: Path) -> str:
    """Return the printed line of how all commands use the solution in a folder."""
    return f"  for all commands: spcola solution use {folder.parent.parent} {folder.name}"
