"""What a version of a solution changed, and the effort that its record states."""

from __future__ import annotations

import filecmp
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fusion.pipeline.solutions import solution_files
from fusion.workspace import Workspace
from fusion.workspace.solution_records import SolutionRecord

_FOLDERS = {
    "MAPFILES": ("maplets", ".MAP"),
    "LMKFILES": ("landmarks", ".LMK"),
    "SUMFILES": ("images", ".SUM"),
}


@dataclass(frozen=True)
class Effort:
    """Effort of making a solution from its parent.

    Attributes
    ----------
    changed : mapping of str to int
        Number of maplets, landmarks and images whose files differ from the parent's, or that the
        parent does not have. Empty for the imported solution.
    items : int or None
        Number of files that were computed; None if not recorded.
    processor_s : float or None
        Processor time of the process that made it, seconds; None if not recorded.
    """

    changed: Mapping[str, int]
    items: int | None
    processor_s: float | None


def effort_of(record: SolutionRecord, version: Workspace, parent: Workspace | None) -> Effort:
    """Return the effort of a version: what differs from its parent, and what its record states."""
    items, processor_s = record.effort.get("items"), record.effort.get("processor_s")
    return Effort(
        {} if parent is None else _changed(version, parent),
        None if items is None else int(items),
        None if processor_s is None else float(processor_s),
    )


def _changed(version: Workspace, parent: Workspace) -> dict[str, int]:
    files, before = solution_files(version), solution_files(parent)
    counts = {}
    for folder, (what, suffix) in _FOLDERS.items():
        known = {path.name: path for path in before[folder]}
        own = [path for path in files[folder] if path.suffix == suffix]
        counts[what] = sum(not _same(path, known.get(path.name)) for path in own)
    return counts


def _same(path: Path, other: Path | None) -> bool:
    """Return whether two files are one, or equal: files are copied where links fail."""
    if other is None:
        return False
    return path.samefile(other) or filecmp.cmp(path, other, shallow=False)
