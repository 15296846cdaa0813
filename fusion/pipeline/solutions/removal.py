"""A solution is removed; a job that is tried again knows what it removed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

from fusion.pipeline.solutions.folder import begun, changing, part_of
from fusion.pipeline.solutions.solutions import solutions_of
from fusion.runtime import content_digest, json_value
from fusion.runtime.folders import LOCK_FILE, locked
from fusion.workspace import IMPORTED, Workspace
from fusion.workspace.json_file import read_object
from fusion.workspace.solution_records import (
    derived_names,
    name_in_use,
    read_record,
    read_solution,
)
from spcola import atomic
from spcola.errors import SpcolaError, WorkspaceError

_REMOVED = ".removed.json"
# Older jobs have ended.
_JOBS = 100


def remove_solution(workspace: Workspace, name: str, *, job: str = "") -> None:
    """Remove a solution, and all that was made with it; also one whose record is damaged.

    Parameters
    ----------
    workspace : Workspace
    name : str
    job : str
        The job of the service that asks for it. One that was interrupted after the removal may ask
        again: the first time is recorded in ``solutions/.removed.json``.

    Raises
    ------
    WorkspaceError
        If there is no such solution, and this job has not removed it; if it is the imported one or
        the one in use, another was made from it, or another program works with it.
    """
    root = workspace.root
    if name == IMPORTED:
        raise WorkspaceError("the imported solution cannot be removed", root)
    with changing(root) as folder:
        removed = _removed(folder) if job else {}
        there = name in derived_names(root)
        # Another one may have got the name since.
        if job in removed and not (there and removed[job] == _digest(folder / name)):
            return
        if not there:
            read_solution(root, name)
        _check_removable(workspace, name)
        gone = part_of(folder / name)
        try:
            with locked(folder / name / LOCK_FILE):
                if job:
                    # First: of a solution that is gone nobody would know who removed it.
                    _note(folder, {**removed, job: _digest(folder / name)})
                # Out of sight at once: a crash leaves no half of it under its name.
                (folder / name).rename(gone)
                if gone.is_symlink():
                    gone.unlink()
                shutil.rmtree(gone, ignore_errors=True)
        except OSError as error:
            raise WorkspaceError(f"cannot be removed ({error.strerror})", folder / name) from error


def _removed(folder: Path) -> dict[str, str]:
    """Return the digest of the solution's record that each job began to remove; oldest first."""
    path = folder / _REMOVED
    return read_object(path) if path.is_file() else {}


def _note(folder: Path, removed: Mapping[str, str]) -> None:
    """Write what :func:`_removed` reads, without the oldest."""
    latest = dict(islice(removed.items(), max(0, len(removed) - _JOBS), None))
    atomic.write_text(folder / _REMOVED, json.dumps(latest, indent=2) + "\n")


def _digest(folder: Path) -> str:
    """Return the digest of a solution's record, with the time when it was made; "" if damaged."""
    try:
        return content_digest(json_value(read_record(folder).as_json()))
    except SpcolaError:
        return ""


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
