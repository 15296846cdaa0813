"""What a solution is, who made it, and which one is in use."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fusion.runtime import json_text
from spcola import atomic
from spcola.errors import WorkspaceError

IMPORTED = "imported"
"""Name of the solution that a workspace began with. Nothing is ever written to it."""
SOLUTION_FOLDER = "solutions"
SOLUTION_FILE = "solution.json"
_IN_USE = "IN_USE"
_LONGEST_NAME = 40


@dataclass(frozen=True)
class SolutionRecord:
    """Where a solution comes from.

    Parameters
    ----------
    name : str
    parent : str
        The solution that it was made from; empty for the imported one.
    made_by : str
        What made it, such as "spcola scale --apply".
    made : str
        UTC, ISO 8601; empty if not known.
    version : str
        Of the program.
    constants : mapping of str to mapping
        What it changed of the settings, by table: body constants such as radius, pole and spin.
    facts : mapping
        Numbers of the change, such as the scale factor, in JSON types.
    digests : mapping of str to str
        SHA-256 of the files from which it was made, and of those that differ from the parent's.
    effort : mapping of str to float
        `items`, files that were computed, and `processor_s`, processor time of the process that
        made it, seconds. Empty if not known.
    """

    name: str
    parent: str = ""
    made_by: str = "spcola init"
    made: str = ""
    version: str = ""
    constants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)
    digests: Mapping[str, str] = field(default_factory=dict)
    effort: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return asdict(self)


def check_name(name: str) -> None:
    """Check the name of a solution to be made.

    Raises
    ------
    WorkspaceError
        If it has other characters than letters, digits, ``-``, ``_`` and ``.``, or is taken.
    """
    plain = name.isascii() and name.replace("-", "").replace("_", "").replace(".", "").isalnum()
    if not (plain and name[0].isalnum() and len(name) <= _LONGEST_NAME):
        raise WorkspaceError(
            f"{name!r} is no name for a solution",
            do=f"use at most {_LONGEST_NAME} letters, digits, '-', '_' and '.'",
        )
    if name in (IMPORTED, _IN_USE, "all"):
        raise WorkspaceError(f"{name!r} is taken", do="choose another name for the solution")


def solution_folder(root: Path, name: str) -> Path:
    """Return the folder of the solution `name` in the workspace `root`."""
    return root if name == IMPORTED else root / SOLUTION_FOLDER / name


def name_in_use(root: Path) -> str:
    """Return the name of the solution in use in the workspace `root`.

    Raises
    ------
    WorkspaceError
        If the file that names it cannot be read.
    """
    path = root / SOLUTION_FOLDER / _IN_USE
    try:
        return path.read_text(encoding="utf-8").strip() or IMPORTED
    except FileNotFoundError:
        return IMPORTED
    except (OSError, ValueError) as error:
        raise WorkspaceError(f"cannot be read ({error})", path, "remove it") from error


def write_name_in_use(root: Path, name: str) -> None:
    """Let the workspace `root` use the solution `name` from now on."""
    folder = root / SOLUTION_FOLDER
    folder.mkdir(exist_ok=True)
    atomic.write_text(folder / _IN_USE, f"{name}\n")


def read_solution(root: Path, name: str) -> SolutionRecord:
    """Read the record of the solution `name` in the workspace `root`.

    Raises
    ------
    WorkspaceError
        If there is no such solution, or its record is damaged.
    """
    if name == IMPORTED:
        return SolutionRecord(IMPORTED)
    path = solution_folder(root, name) / SOLUTION_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        record = SolutionRecord(**content)
        known = record.name == name and all(
            isinstance(each, Mapping)
            for each in (record.constants, record.effort, *record.constants.values())
        )
    except FileNotFoundError as error:
        there = ", ".join([IMPORTED, *derived_names(root)])
        raise WorkspaceError(
            f"there is no solution {name!r}", root, f"there are: {there}"
        ) from error
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise WorkspaceError(f"cannot be read ({error})", path) from error
    if not known:
        raise WorkspaceError("is not the record of this solution", path)
    return record


def write_solution(folder: Path, record: SolutionRecord) -> None:
    """Write the record of a solution into its folder."""
    atomic.write_text(folder / SOLUTION_FILE, json_text(record.as_json()))


def derived_names(root: Path) -> list[str]:
    """Return the names of all solutions in the workspace `root` but the imported one, sorted."""
    folder = root / SOLUTION_FOLDER
    return sorted(path.parent.name for path in folder.glob(f"[!.]*/{SOLUTION_FILE}"))
