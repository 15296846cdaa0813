"""The registration as other programs read it (``registration.json``), and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.registration.fit import (
    LIDAR_FRAME,
    SPC_FRAME,
    Registration,
    shear_significance,
    similarity_numbers,
)
from fusion.registration.landmarks import LandmarkErrors
from fusion.registration.match import Match
from fusion.registration.scans import ScanEffects
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.maplet import MapletGrid
from spcola.similarity import Affine, Similarity


@dataclass(frozen=True, eq=False)
class MatchedMapolas:
    """All mapolas, those that do not match too, and how scan errors reach them.

    Attributes
    ----------
    matches : sequence of Match
        N of them.
    scans : ScanEffects
    effects : (N, 3, M) ndarray
        ``scans.at`` of each mapola.
    beside : (N, 3, 3) ndarray
        ``scans.beside`` of each mapola, m².
    landmarks : LandmarkErrors, optional
        How the maplets err to which they were matched; unknown by default.
    """

    matches: Sequence[Match]
    scans: ScanEffects
    effects: FloatArray
    beside: FloatArray
    landmarks: LandmarkErrors | None = None

    @property
    def usable(self) -> BoolArray:
        """Mask (N,) of those that match."""
        return np.array([match.usable for match in self.matches], dtype=bool)


def registration_json(
    registration: Registration,
    mapolas: MatchedMapolas,
) -> dict[str, Any]:
    """Content of ``registration.json`` (DESIGN: keys that other programs read).

    Parameters
    ----------
    registration : Registration
        Fitted to the usable ones of `mapolas`, in their order.
    mapolas : MatchedMapolas

    Returns
    -------
    dict
        Units stand in the keys; arrays and NaN are turned into JSON where it is written.
    """
    scale, scale_sigma, rotation, rotation_sigma = similarity_numbers(registration)
    fit = registration.fit
    sigma = np.sqrt(np.diag(registration.covariance))
    scans = mapolas.scans
    offsets = scans.offsets(registration.strengths)
    felt = fit.sizes.shared[0] * mapolas.effects[mapolas.usable]
    content: dict[str, Any] = {
        "model": registration.model,
        "scale": scale,
        "scale_sigma": scale_sigma,
        "rotation_deg": np.degrees(rotation),
        "rotation_sigma_deg": np.degrees(rotation_sigma),
        "translation_m": registration.transform.translation,
        "translation_sigma_m": sigma[:3],
        "residual_std_m": registration.residual_std,
        "n_used": int(np.count_nonzero(fit.used)),
        "n_rejected": len(mapolas.matches) - int(np.count_nonzero(fit.used)),
        "parameters": list(registration.parameters),
        "covariance": registration.covariance,
        "maplet_sigma_m": fit.sizes.independent,
        "scan_sigma_m": float(np.sqrt(np.sum(felt**2) / (3.0 * len(felt)))),
        "per_scan": [
            {"scan": name, "offset_m": offset}
            for name, offset in zip(scans.names, offsets, strict=True)
        ],
        "iterations": registration.iterations,
        "converged": fit.converged,
        "reason": fit.reason,
        "landmarks": None if mapolas.landmarks is None else mapolas.landmarks.as_json(),
        "per_mapola": _per_mapola(registration, mapolas),
    }
    if registration.model == "affine":
        content["matrix"] = registration.transform.matrix
        strain, strain_sigma = shear_significance(registration) or (None, None)
        content["strain"], content["strain_sigma"] = strain, strain_sigma
    return content


def _per_mapola(registration: Registration, mapolas: MatchedMapolas) -> list[dict[str, Any]]:
    """One entry for each mapola: what was found, and why it was not used if it was not."""
    fit, entries, row = registration.fit, [], 0
    centers = np.array([match.center for match in mapolas.matches])
    covariance = registration.position_covariance(centers, mapolas.effects) + mapolas.beside
    shift = mapolas.effects @ registration.strengths
    moved = np.array([match.displacement for match in mapolas.matches]).reshape(-1, 3)
    surface = centers + moved - registration.transform.apply(centers) - shift
    for number, match in enumerate(mapolas.matches):
        residual: FloatArray = np.full(3, np.nan)
        reason, used = match.reason, False
        if match.usable:
            residual, used = fit.conditional[row], bool(fit.used[row])
            reason = "" if used else "disagrees with the other mapolas"
            row += 1
        entries.append(
            {
                "name": match.name,
                "center_m": match.center,
                "displacement_m": match.displacement,
                "sigma_m": np.sqrt(np.diag(match.covariance)),
                "scan_shift_m": shift[number],
                "residual_m": residual,
                "surface_residual_m": surface[number] if used else np.full(3, np.nan),
                "position_covariance_m2": covariance[number],
                "used": used,
                "reason": reason,
                "coverage": match.coverage,
                "correlation": match.correlation,
            }
        )
    return entries


def transform_of(content: Mapping[str, Any], where: str) -> Affine:
    """Read the transform from lidar to SPC coordinates (metres) out of ``registration.json``.

    `where` is named in errors.

    Raises
    ------
    InvalidValueError
        If a key is missing or is not a number.
    """
    try:
        translation = np.array(content["translation_m"], dtype=np.float64)
        if content["model"] == "affine":
            return Affine(content["matrix"], translation, SPC_FRAME, LIDAR_FRAME)
        turn = np.radians(np.array(content["rotation_deg"], dtype=np.float64))
        scale = float(content["scale"])
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(
            f"has no usable transform ({error})", where, "remove it and register again"
        ) from error
    return Similarity.from_rotation_vector(
        turn, translation, scale, SPC_FRAME, LIDAR_FRAME
    ).as_affine()


@dataclass(frozen=True, eq=False)
class Placement:
    """How a mapola is registered.

    Attributes
    ----------
    shift : (3,) ndarray
        What the errors of its scans add to the transform, SPC coordinates, metres.
    residual : (3,) ndarray
        How far the SPC surface lies from the registered mapola, metres; NaN if it does not match.
    covariance : (3, 3) ndarray
        Of where it is registered, m².
    """

    shift: FloatArray
    residual: FloatArray
    covariance: FloatArray

    def grid(self, grid: MapletGrid, transform: Affine) -> MapletGrid:
        """Return where the grid of a mapola is registered."""
        moved = grid.moved(transform)
        return replace(moved, center=moved.center + self.shift)


def placements_of(content: Mapping[str, Any], where: str) -> dict[str, Placement]:
    """Read how each mapola is registered out of ``registration.json``; `where` is for errors.

    Raises
    ------
    InvalidValueError
        If a key is missing or does not hold what it should.
    """
    try:
        return {
            str(entry["name"]): Placement(
                _vector(entry["scan_shift_m"]),
                _to_surface(entry),
                np.array(entry["position_covariance_m2"], dtype=np.float64).reshape(3, 3),
            )
            for entry in content["per_mapola"]
        }
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(
            f"has no usable mapolas ({error})", where, "remove it and register again"
        ) from error


def _to_surface(entry: Mapping[str, Any]) -> FloatArray:
    """How far the SPC surface lies (3,), metres: of a fit by images not what is left of that."""
    if "surface_residual_m" in entry:
        return _vector(entry["surface_residual_m"])
    return _vector(entry["residual_m"]) if entry["used"] else np.full(3, np.nan)


def _vector(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64).reshape(3)
