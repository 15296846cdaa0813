"""What a solution is, who made it, and which one is in use."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from fusion.runtime import content_digest, json_text, json_value
from fusion.workspace.json_file import read_object
from fusion.workspace.settings import problem_text
from spcola import atomic
from spcola.errors import WorkspaceError

IMPORTED = "imported"
"""Name of the solution that a workspace began with. Nothing is ever written to it."""
SOLUTION_FOLDER = "solutions"
SOLUTION_FILE = "solution.json"
_IN_USE = "IN_USE"
_LONGEST_NAME = 40
_CHECKSUM = "checksum"
# Facts of an exported solution that are of its maplets, wherever these go.
_OF_MAPLETS = ("lidar_in_maplets",)
_MEND = "bring it back from a copy, or remove the solution: spcola solution remove"


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
        :meth:`fusion.workspace.Workspace.settings` checks them.
    facts : mapping
        Numbers of the change, such as the scale factor, in JSON types.
    digests : mapping of str to str
        SHA-256 of the files from which it was made.
    effort : mapping of str to float
        `items`, files that were computed, and `processor_s`, processor time of the process that
        made it, seconds. Empty if not known.
    settings : mapping of str to mapping
        Settings with which it was computed, by table. Empty if not known.
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
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types."""
        return asdict(self)


# As an item of a tuple: a dataclass of its own takes no configuration.
_CHECK: TypeAdapter[tuple[SolutionRecord]] = TypeAdapter(
    tuple[SolutionRecord], config=ConfigDict(extra="forbid", strict=True)
)


def check_name(name: str) -> None:
    """Check the name of a solution to be made.

    Raises
    ------
    WorkspaceError
        If it has other characters than letters, digits, ``-``, ``_`` and ``.``, or is taken.
    """
    if not _is_name(name):
        raise WorkspaceError(
            f"{name!r} is no name for a solution",
            do=f"use at most {_LONGEST_NAME} letters, digits, '-', '_' and '.'",
        )
    # Some file systems do not distinguish capitals.
    if name.lower() in (IMPORTED, _IN_USE.lower(), "all"):
        raise WorkspaceError(f"{name!r} is taken", do="choose another name for the solution")


def _is_name(name: str) -> bool:
    plain = name.isascii() and name.replace("-", "").replace("_", "").replace(".", "").isalnum()
    return plain and name[0].isalnum() and len(name) <= _LONGEST_NAME


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
    atomic.write_text(root / SOLUTION_FOLDER / _IN_USE, f"{name}\n")


def read_solution(root: Path, name: str) -> SolutionRecord:
    """Read the record of the solution `name` in the workspace `root`.

    Raises
    ------
    WorkspaceError
        If there is no such solution, or its record is damaged.
    """
    if name == IMPORTED:
        return SolutionRecord(IMPORTED, facts=_facts_of_imported(root))
    names = derived_names(root)
    if name not in names:
        there = ", ".join([IMPORTED, *names])
        raise WorkspaceError(
            f"there is no solution {name!r}", root,
            f"there are: {there}; choose one: spcola solution use, or --solution",
        )  # fmt: skip
    folder = solution_folder(root, name)
    record = read_record(folder)
    if record.name != name:
        raise WorkspaceError(
            f"is the record of the solution {record.name!r}", folder / SOLUTION_FILE, _MEND
        )
    return record


def _facts_of_imported(root: Path) -> dict[str, Any]:
    """Return what an exported solution of which a workspace was made states of its maplets.

    Its constants are in the settings of the workspace.
    """
    if not (root / SOLUTION_FILE).is_file():
        return {}
    facts = read_record(root).facts
    return {key: facts[key] for key in _OF_MAPLETS if key in facts}


def read_record(folder: Path) -> SolutionRecord:
    """Read the record in the folder of a solution, or in one that was exported.

    Raises
    ------
    WorkspaceError
        If it cannot be read or is damaged.
    """
    path = folder / SOLUTION_FILE
    content = read_object(path, _MEND)
    checksum = content.pop(_CHECKSUM, "")
    if checksum != content_digest(content):
        raise WorkspaceError("fails its checksum: it was damaged or edited", path, _MEND)
    try:
        (record,) = _CHECK.validate_json(json.dumps([content]))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        place = " ".join([f"{path}:", *(str(part) for part in problem["loc"][1:])])
        raise WorkspaceError(problem_text(problem), place, _MEND) from error
    return record


def write_record(folder: Path, record: SolutionRecord) -> None:
    """Write the record of a solution, with a checksum, into its folder."""
    content = json_value(record.as_json())
    checksum = content_digest(content)
    atomic.write_text(folder / SOLUTION_FILE, json_text({**content, _CHECKSUM: checksum}))


def derived_names(root: Path) -> list[str]:
    """Return the names of all solutions in the workspace `root` but the imported one, sorted."""
    try:
        entries = [*(root / SOLUTION_FOLDER).iterdir()]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise WorkspaceError(
            f"cannot be listed ({error.strerror})", root / SOLUTION_FOLDER
        ) from error
    names = sorted(path.name for path in entries if path.is_dir() and _is_name(path.name))
    return [name for name in names if name != IMPORTED]
