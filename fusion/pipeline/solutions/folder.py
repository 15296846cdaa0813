"""The folder of all solutions: one program at a time adds to it or removes from it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fusion.runtime.folders import LOCK_FILE, clear_leftovers, locked, make_folder
from fusion.workspace.solution_records import SolutionRecord, read_record, solution_folder
from spcola.errors import SpcolaError


@contextmanager
def changing(root: Path) -> Iterator[Path]:
    """Lock the folder of all solutions of the workspace `root` for a moment, and yield it.

    What a killed program left there is removed.
    """
    folder = solution_folder(root, "x").parent
    make_folder(folder)
    with locked(folder / LOCK_FILE, wait=True):
        clear_leftovers([folder])
        yield folder


def part_of(folder: Path) -> Path:
    """Return the hidden folder in which a solution is made or removed."""
    return folder.with_name(f".{folder.name}.part")


def begun(root: Path) -> list[SolutionRecord]:
    """Return the records of the solutions that are being made."""
    found = []
    for folder in solution_folder(root, "x").parent.glob(".*.part"):
        try:
            found.append(read_record(folder))
        except SpcolaError:
            continue
    return found
