"""Maplets around a solved one, as they hid and shaded its ground when it was solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from fusion.report.photoclinometry.albedo import goodness_path
from fusion.scene import caster_around
from fusion.workspace import Workspace
from fusion.workspace.solution_records import read_solution
from spcola.shape import RayCaster

__all__ = ["around_caster", "around_files"]


def around_files(workspace: Workspace, one: Mapping[str, Any]) -> list[Path]:
    """Return the files of the maplets around one; those that are gone are left out.

    They are those of the solution from which it was solved: what hides and shades ground does not
    change from round to round.

    Parameters
    ----------
    workspace : Workspace
        In the solution.
    one : mapping
        Of ``photoclinometry.json``, of the maplet.

    Raises
    ------
    WorkspaceError
        If the record of the solution cannot be read.
    """
    parent = _parent(workspace)
    return [parent.maplet_path(name) for name in _there(parent, one)]


def around_caster(workspace: Workspace, one: Mapping[str, Any], gsd: float) -> RayCaster | None:
    """Return the surface of the maplets around one; None if there are none.

    Parameters
    ----------
    workspace, one
        As of :func:`around_files`.
    gsd : float
        Of the maplet, metres.

    Raises
    ------
    SpcolaError
        If a file cannot be read.
    """
    parent = _parent(workspace)
    return caster_around((parent.maplet(name) for name in _there(parent, one)), gsd)


def _parent(workspace: Workspace) -> Workspace:
    """Return the workspace in the solution from which this one was made.

    An exported solution, of which a workspace was made, has no parent there.
    """
    # Made together with the record.
    made = goodness_path(workspace).stat().st_mtime_ns
    parent = _parent_name(workspace.root, workspace.solution, made)
    return replace(workspace, solution=parent) if parent else workspace


@lru_cache(maxsize=8)
def _parent_name(root: Path, solution: str, made: int) -> str:  # noqa: ARG001
    """Return the parent of a solution; its record names many files, and each picture needs it."""
    return read_solution(root, solution).parent


def _there(parent: Workspace, one: Mapping[str, Any]) -> list[str]:
    """Return the names of the maplets around; solutions of former versions do not state them."""
    return [name for name in one.get("around", ()) if parent.maplet_path(name).is_file()]
