"""Why a recovered parameter is off by more than three sigma: one line for each.

Two errors that are planted move parameters in a way that can be computed: those of SPC's camera
positions, by which the scale stage locates the lidar, and those of the maplets' centres, to which
the registration moves it. What they come to is a least-squares solution of the same parameters, all
observations weighted alike. The rest is set against chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import norm

from fusion.report.planted import RecoveredParameter
from fusion.truth.planted import Planted
from fusion.workspace import Workspace
from spcola.arrays import FloatArray

LARGE_PULL = 3.0
"""Pulls beyond this are explained."""

_REGISTRATION = ("registration rotation", "registration translation")
_SCALE = ("pole", "centre offset")


def explained(
    rows: Sequence[RecoveredParameter],
    planted: Planted,
    workspace: Workspace,
    scale: Mapping[str, Any],
) -> list[RecoveredParameter]:
    """Return the rows with an explanation of each pull beyond :data:`LARGE_PULL`.

    Parameters
    ----------
    rows : sequence of RecoveredParameter
    planted : Planted
    workspace : Workspace
        Where SPC's states of the images are read from, if they are needed.
    scale : mapping
        Content of ``scale.json``.
    """
    large = [row for row in rows if abs(row.pull) > LARGE_PULL]
    if not large:
        return list(rows)
    shares = _of_centers(planted) | _of_states(planted, workspace, scale)
    count = sum(bool(np.isfinite(row.pull)) for row in rows)
    return [
        replace(row, explanation=_line(row, shares.get(row.name), count)) if row in large else row
        for row in rows
    ]


def chance(pull: float, count: int) -> float:
    """Return the probability that any of `count` independent normal pulls is as large as `pull`."""
    one = 2.0 * float(norm.sf(abs(pull)))
    # No pull at all is sure: log 0 is meant.
    with np.errstate(divide="ignore"):
        return float(-np.expm1(count * np.log1p(-one)))


def _line(row: RecoveredParameter, share: tuple[float, str] | None, count: int) -> str:
    """Return the explanation of one large pull."""
    missions = 1.0 / max(chance(row.pull, count), 1e-12)
    by_chance = (
        f"by chance one mission in {float(f'{missions:.2g}'):,.0f} has such a pull among "
        f"{count} parameters"
    )
    if share is None:
        return f"no planted error is known that explains it; {by_chance}"
    value, errors = share
    error, unit = row.recovered - row.planted, f" {row.unit}" if row.unit else ""
    rest = (error - value) / row.sigma
    found = f"{value:+.2g} of {error:+.2g}{unit} come from {errors}"
    word = (
        "the rest is within three sigma" if abs(rest) <= LARGE_PULL else "the rest is unexplained"
    )
    return f"{found}; {word} ({rest:+.1f} σ); {by_chance}"


def _of_centers(planted: Planted) -> dict[str, tuple[float, str]]:
    """Return what planted errors of the maplets' centres add to the registration's parameters."""
    centers = list(planted.centers.values())
    if len(centers) < 3:
        return {}
    true = planted.similarity.apply(np.array([center.true_center_m for center in centers]))
    errors = np.array([center.center_m for center in centers]) - true
    scale, translation, rotation = _fitted(true, errors)
    cause = "the planted errors of the maplets' centres"
    found = {"registration scale": (scale * planted.similarity.scale, cause)}
    for name, vector in zip(_REGISTRATION, (rotation, translation), strict=True):
        found |= {f"{name} {axis}": (float(vector[k]), cause) for k, axis in enumerate("xyz")}
    return found


def _of_states(
    planted: Planted, workspace: Workspace, scale: Mapping[str, Any]
) -> dict[str, tuple[float, str]]:
    """Return what planted errors of SPC's camera positions add to the scale's parameters.

    Only with SPC's trajectory do lidar surfaces lie where these errors take them.
    """
    used = [pair["image"] for pair in scale.get("per_pair", ()) if pair["used"]]
    used = [name for name in dict.fromkeys(used) if name in planted.images]
    if scale.get("trajectory", "spc") != "spc" or len(used) < 3:
        return {}
    solved = np.array([workspace.image(name).position for name in used])
    true = planted.similarity.apply(np.array([planted.images[name].position_m for name in used]))
    # Ranges, not positions, are scaled and turned with the trajectory: from spacecraft to ground.
    ground = planted.settings.body.radius * true / np.linalg.norm(true, axis=1, keepdims=True)
    epsilon, offset, rotation = _fitted(ground - true, solved - true)
    cause = f"the planted errors of SPC's camera positions in the {len(used)} images of the pairs"
    found = {
        "epsilon": (epsilon, cause),
        "size correction": (epsilon * planted.settings.body.radius, cause),
        "prime meridian": (-float(rotation[2]), cause),
    }
    for name, vector, axes in zip(_SCALE, (-rotation, offset), ("xy", "xyz"), strict=True):
        found |= {f"{name} {axis}": (float(vector[k]), cause) for k, axis in enumerate(axes)}
    return found


def _fitted(arms: FloatArray, moved: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Fit ``moved = ε a + c + θ × a`` to displacements (N, 3) of points at arms a (N, 3), metres.

    Returns
    -------
    scale : float
        ε.
    offset : (3,) ndarray
        c, metres.
    rotation : (3,) ndarray
        θ, degrees.
    """
    turning = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    center = np.broadcast_to(np.eye(3), (len(arms), 3, 3))
    design = np.concatenate([arms[:, :, None], center, turning], axis=2).reshape(-1, 7)
    found = np.linalg.lstsq(design, moved.ravel(), rcond=None)[0]
    return float(found[0]), found[1:4], np.degrees(found[4:])
