"""Results of a workspace: residuals of the registration, ε by day, local time and longitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion.report.figures import binned
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.errors import FormatError, WorkspaceError
from spcola.math import local_axes, lon_lat_deg

__all__ = ["RESULTS", "epsilon_table", "residuals", "result_json"]

RESULTS: Mapping[str, str] = {
    "registration": "registration.json",
    "scale": "scale.json",
    "manifest": "release/manifest.json",
}
"""Results that are JSON, and their files."""
_BINS = 12
_KEPT = ("name", "sigma_m", "used", "cause", "reason", "correlation", "coverage", "n_images")


def result_json(workspace: Workspace, name: str) -> dict[str, Any]:
    """Return the content of a result, one of :data:`RESULTS`.

    Parameters
    ----------
    workspace : Workspace
    name : str

    Raises
    ------
    WorkspaceError
        If there is none of that name, or it cannot be read.
    """
    if name not in RESULTS:
        do = f"there are: {', '.join(RESULTS)}"
        raise WorkspaceError(f"there is no result {name!r}", workspace.root, do)
    content = workspace.find_json(RESULTS[name])
    if content is None:
        where = workspace.home / RESULTS[name]
        raise WorkspaceError("is not there yet", where, f"run: spcola run {workspace.root}")
    return content


def residuals(workspace: Workspace) -> dict[str, Any]:
    """Return the matches of the registration with their residuals.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    dict
        `model`, `verdict`, `n_used`, `n_rejected`, and `matches`: of each mapola its place, the
        residual along body-fixed axes and towards east, north and up (metres; NaN where it does
        not match), whether it was `used`, and if not why: `cause` (a code) and `reason`.

    Raises
    ------
    WorkspaceError
        If there is no registration.
    FormatError
        If it is damaged.
    """
    content = result_json(workspace, "registration")
    head = {key: content.get(key) for key in ("model", "verdict", "n_used", "n_rejected")}
    try:
        matches = _matches(content["per_mapola"])
    except (KeyError, TypeError, ValueError) as error:
        path = workspace.registration_path
        raise FormatError(f"has no usable mapolas ({error!r})", path, "register again") from error
    return {**head, "matches": matches}


def epsilon_table(workspace: Workspace) -> dict[str, Any]:
    """Return ε with its sigma: of all, per day, and by local time and longitude.

    Parameters
    ----------
    workspace : Workspace

    Returns
    -------
    dict
        `epsilon`, `epsilon_sigma`; `per_day` as in ``scale.json``; for `local_time_h` and
        `longitude_deg` the `single` values of pairs (or shots), of which `used` ones enter the
        `bins`: middle, mean and standard error, NaN for a single value; `trends`.

    Raises
    ------
    WorkspaceError
        If there is no scale.
    FormatError
        If it is damaged.
    """
    content = result_json(workspace, "scale")
    keys = ("epsilon", "epsilon_sigma", "method", "verdict", "trends", "reasons")
    single = content.get("per_pair") or content.get("per_shot") or []
    try:
        return {
            **{key: content.get(key) for key in keys},
            "per_day": content.get("per_day") or [],
            "local_time_h": _against(single, "local_time_h", 24.0),
            "longitude_deg": _against(single, "longitude_deg", 360.0),
        }
    except (TypeError, ValueError, AttributeError) as error:
        where = workspace.scale_path
        raise FormatError(f"has no usable values of ε ({error!r})", where, "scale again") from error


def _matches(entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the mapolas of the registration."""
    centers = _vectors([entry["center_m"] for entry in entries])
    # Where nothing could be registered, no match has a residual.
    residuals = _vectors([entry.get("residual_m") or [None] * 3 for entry in entries])
    longitudes, latitudes = lon_lat_deg(centers)
    south, east, up = np.einsum("nij,nj->in", local_axes(centers), residuals)
    columns = {
        "longitude_deg": longitudes,
        "latitude_deg": latitudes,
        "radius_m": np.linalg.norm(centers, axis=1),
        "residual_m": residuals,
        "residual_east_m": east,
        "residual_north_m": -south,
        "residual_up_m": up,
        "size_m": np.linalg.norm(residuals, axis=1),
    }
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [
        {key: entry[key] for key in _KEPT if key in entry} | dict(zip(columns, row, strict=True))
        for entry, row in zip(entries, rows, strict=True)
    ]


def _against(entries: Sequence[Mapping[str, Any]], key: str, full: float) -> dict[str, Any]:
    """Return single values of ε against an angle, and means in twelve bins of it."""
    known = [each for each in entries if None not in (each.get("epsilon"), each.get(key))]
    at, epsilon = (np.array([each[k] for each in known], dtype=float) for k in (key, "epsilon"))
    sigma = _numbers(known, "epsilon_sigma")
    used = np.array([bool(each.get("used", True)) for each in known], dtype=bool)
    middles, means, errors = binned(at[used], epsilon[used], np.linspace(0.0, full, _BINS + 1))
    return {
        "single": {"at": at, "epsilon": epsilon, "epsilon_sigma": sigma, "used": used},
        "bins": {"at": middles, "epsilon": means, "standard_error": errors},
    }


def _numbers(entries: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    """Return the values of a key (N,); NaN for null."""
    values = [each.get(key) for each in entries]
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _vectors(rows: Sequence[Sequence[float | None]]) -> FloatArray:
    """Return vectors (N, 3); NaN for null."""
    # With the type float numpy makes NaN of None.
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
