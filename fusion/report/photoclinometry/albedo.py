"""Maplets of which only the albedo was solved, as those that were solved whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusion.workspace import Workspace

__all__ = ["as_solved", "goodness_path"]

_FILE = "albedo.json"
_FIT = (
    "outcome", "residual_start", "residual", "noise_ratio", "correlation", "shift_px", "shift_m",
    "sigma_m", "images",
)  # fmt: skip


def goodness_path(workspace: Workspace) -> Path:
    """Return the file that has how images fit maplets; it may be missing.

    It is ``photoclinometry.json``, or ``albedo.json`` where only the albedo was solved.

    Parameters
    ----------
    workspace : Workspace
        In the solution.
    """
    solved, albedo = workspace.photoclinometry_path, workspace.home / _FILE
    return albedo if albedo.is_file() and not solved.is_file() else solved


def as_solved(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``albedo.json`` with the keys of ``photoclinometry.json``.

    Slopes and heights are kept, so that what is known of solved ones is None, or empty.

    Parameters
    ----------
    content : mapping
        Of ``albedo.json``, of maplets or of mapolas as maplets.

    Raises
    ------
    KeyError
        If it lacks something.
    """
    heads = ("options", "outcomes", "residual_start", "residual", "shift_m", "images", "findings")
    return {
        **{key: content[key] for key in heads},
        "maplets": {name: _maplet(one) for name, one in content["surfaces"].items()},
    }


def _maplet(one: Mapping[str, Any]) -> dict[str, Any]:
    return {
        **{key: one[key] for key in _FIT},
        "reason": _reason(one),
        "albedo_sigma": one["sigma"],
        "directions": [],
        "light_ratio": None,
        "shift_ratio": None,
        "constraints": {},
        "rounds": [
            {"gsd_m": one["gsd_m"], "residual": residual, "height_m": None, "albedo": change}
            for residual, change in zip(one["residuals"], one["changes"], strict=True)
        ],
    }


def _reason(one: Mapping[str, Any]) -> str:
    """Return what was done, in one clause."""
    what = f"mapola {one['mapola']} as a maplet: heights" if "mapola" in one else "heights"
    if not one["changes"]:
        return f"{what} are kept, and no image shows enough of it for its albedo"
    return (
        f"{what} are kept; images determine the albedo of {one['share']:.0%} of the points, which "
        f"changed by {one['changes'][-1]:.2g} in the last round"
    )
