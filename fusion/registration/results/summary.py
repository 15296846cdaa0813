"""The registration as ``registration.json``, written and read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.estimation import influence
from fusion.registration.fit.fit import LIDAR_FRAME, SPC_FRAME, Registration
from fusion.registration.fit.known import KnownTransform
from fusion.registration.fit.landmarks import LandmarkErrors
from fusion.registration.fit.reasons import registration_reasons
from fusion.registration.fit.significance import departures_json
from fusion.registration.fit.stability import stability_json
from fusion.registration.results.scans import ScanEffects
from fusion.surfacematch import Match
from fusion.verdict import Cause
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

DISAGREES = "disagrees with the other mapolas"
"""Reason why a mapola that matches is not used."""


@dataclass(frozen=True, eq=False)
class MatchedMapolas:
    """All mapolas, including those that do not match, and their shared errors.

    Attributes
    ----------
    matches : sequence of Match
        N of them.
    scans : ScanEffects
    effects : (N, 3, M) ndarray
        ``scans.at`` of each mapola.
    residual_covariance : (N, 3, 3) ndarray
        ``scans.residual_covariance`` of each mapola, m².
    landmarks : LandmarkErrors, optional
        Errors of the maplets to which they were matched; unknown by default.
    """

    matches: Sequence[Match]
    scans: ScanEffects
    effects: FloatArray
    residual_covariance: FloatArray
    landmarks: LandmarkErrors | None = None

    @property
    def usable(self) -> BoolArray:
        """Mask (N,) of those that match."""
        return np.array([match.usable for match in self.matches], dtype=bool)


def registration_json(
    registration: Registration,
    mapolas: MatchedMapolas,
) -> dict[str, Any]:
    """Content of ``registration.json``; its keys: :mod:`fusion.registration.results.keys`.

    Parameters
    ----------
    registration : Registration
        Fitted to the usable ones of `mapolas`, in their order.
    mapolas : MatchedMapolas

    Returns
    -------
    dict
        Keys name the units; arrays and NaN are converted to JSON when written.
    """
    fit, scans = registration.fit, mapolas.scans
    known = KnownTransform(registration.model, registration.transform, registration.covariance)
    by_scans = fit.sizes.shared[0] * mapolas.effects[mapolas.usable]
    centers = np.stack([match.center for match in mapolas.matches])[mapolas.usable]
    content: dict[str, Any] = {
        **known.numbers(),
        "residual_std_m": registration.residual_std,
        "n_used": int(np.count_nonzero(fit.used)),
        "n_rejected": len(mapolas.matches) - int(np.count_nonzero(fit.used)),
        "maplet_sigma_m": fit.sizes.independent,
        "scan_sigma_m": float(np.sqrt(np.sum(by_scans**2) / (3.0 * len(by_scans)))),
        "per_scan": per_scan_json(scans, scans.displacements(registration.strengths)),
        "iterations": registration.iterations,
        "converged": fit.converged,
        "reason": fit.reason,
        "landmarks": None if mapolas.landmarks is None else mapolas.landmarks.as_json(),
        "per_mapola": per_mapola_json(mapolas, _placed(registration, mapolas)),
        "tests": departures_json(registration, centers),
        "stability": stability_json(registration, centers),
        "inverse": known.inverse().numbers(),
        "reasons": registration_reasons(registration, centers),
    }
    if registration.model == "affine":
        found = content["tests"]["strain"]
        content |= {key: found[key] for key in ("strain", "strain_sigma")}
    return content


def scale_influence(registration: Registration, mapolas: MatchedMapolas) -> FloatArray:
    """Derivative (N, 3), 1/m, of the scale of a similarity by the displacement of each match.

    0 for matches that were not used.

    Parameters
    ----------
    registration : Registration
    mapolas : MatchedMapolas
        To which it was fitted.
    """
    moved = np.zeros((len(mapolas.matches), 3))
    of_all = influence(registration.observations, registration.fit)
    moved[mapolas.usable] = of_all[registration.parameters.index("scale")]
    return moved


def per_scan_json(scans: ScanEffects, displacement: FloatArray) -> list[dict[str, Any]]:
    """One entry for each scan: the additions to its adjustment, (S, 6) metres and radians."""
    return [
        {
            "scan": name,
            "center_m": center,
            "offset_m": moved[:3],
            "rotation_deg": np.degrees(moved[3:]),
        }
        for name, center, moved in zip(scans.names, scans.center, displacement, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Placed:
    """Registered positions of all mapolas, including those that do not match.

    Attributes
    ----------
    shift : (N, 3) ndarray
        Displacement by the errors of their scans, SPC coordinates, metres.
    residual : (N, 3) ndarray
        Residual of the fit, metres; NaN without match.
    surface : (N, 3) ndarray
        SPC surface minus registered lidar, metres; NaN if not used.
    covariance : (N, 3, 3) ndarray
        Of the registered positions, m².
    used : (N,) bool ndarray
        Whether the match was used.
    """

    shift: FloatArray
    residual: FloatArray
    surface: FloatArray
    covariance: FloatArray
    used: BoolArray


def _placed(registration: Registration, mapolas: MatchedMapolas) -> Placed:
    """Registered positions of the mapolas by a fit."""
    centers = np.array([match.center for match in mapolas.matches])
    residual, used = np.full(centers.shape, np.nan), mapolas.usable
    residual[used] = registration.fit.conditional
    used[used] = registration.fit.used
    shift = mapolas.effects @ registration.strengths
    moved = np.array([match.displacement for match in mapolas.matches]).reshape(-1, 3)
    surface = centers + moved - registration.transform.apply(centers) - shift
    surface[~used] = np.nan
    return Placed(
        shift=shift,
        residual=residual,
        surface=surface,
        covariance=registration.position_covariance(centers, mapolas.effects)
        + mapolas.residual_covariance,
        used=used,
    )


def per_mapola_json(mapolas: MatchedMapolas, placed: Placed) -> list[dict[str, Any]]:
    """One entry for each mapola: its match and registration, and the reason if it was not used."""
    return [
        {
            "name": match.name,
            "center_m": match.center,
            "displacement_m": match.displacement,
            "sigma_m": np.sqrt(np.diag(match.covariance)),
            "scan_shift_m": placed.shift[number],
            "residual_m": placed.residual[number],
            "surface_residual_m": placed.surface[number],
            "position_covariance_m2": placed.covariance[number],
            "used": bool(placed.used[number]),
            **_left_out(match, bool(placed.used[number])),
            "coverage": match.coverage,
            "correlation": match.correlation,
        }
        for number, match in enumerate(mapolas.matches)
    ]


def _left_out(match: Match, used: bool) -> dict[str, Any]:
    """Return the reason why a match is not used, as text and code; empty and null if it is."""
    if used or match.reason:
        return {"reason": match.reason, "cause": match.cause}
    return {"reason": DISAGREES, "cause": Cause.OUTLIER}


_AGAIN = "remove it and register again"


def transform_of(content: Mapping[str, Any], where: str, *, do: str = _AGAIN) -> Affine:
    """Read the transform from lidar to SPC coordinates (metres) out of ``registration.json``.

    Errors name the file `where` and the remedy `do`.

    Parameters
    ----------
    content : mapping
    where, do : str

    Raises
    ------
    InvalidValueError
        If a key is missing or is not a number, or the registration is refused.
    """
    if content.get("verdict") == "refused":
        raise InvalidValueError("is from a registration that was refused", where, do)
    try:
        translation = np.array(content["translation_m"], dtype=np.float64)
        if content["model"] == "affine":
            return Affine(content["matrix"], translation, SPC_FRAME, LIDAR_FRAME)
        turn = np.radians(np.array(content["rotation_deg"], dtype=np.float64))
        scale = float(content["scale"])
        return Similarity.from_rotation_vector(
            turn, translation, scale, SPC_FRAME, LIDAR_FRAME
        ).as_affine()
    except (KeyError, TypeError, ValueError, OverflowError, InvalidValueError) as error:
        raise InvalidValueError(f"has no usable transform ({error})", where, do) from error


@dataclass(frozen=True, eq=False)
class Placement:
    """Registration of one mapola, in addition to the transform.

    Attributes
    ----------
    shift : (3,) ndarray
        Displacement by the errors of its scans, SPC coordinates, metres.
    residual : (3,) ndarray
        SPC surface minus registered mapola, metres; NaN if it does not match.
    covariance : (3, 3) ndarray
        Of its registered position, m².
    """

    shift: FloatArray
    residual: FloatArray
    covariance: FloatArray

    def grid(self, grid: MapletGrid, transform: Affine) -> MapletGrid:
        """Return the registered grid of a mapola.

        Parameters
        ----------
        grid : MapletGrid
            Of the mapola, lidar coordinates.
        transform : Affine
            Lidar → SPC.
        """
        moved = grid.moved(transform)
        return replace(moved, center=moved.center + self.shift)


def placements_of(content: Mapping[str, Any], where: str) -> dict[str, Placement]:
    """Read the registration of each mapola from ``registration.json``; `where` is for errors.

    Parameters
    ----------
    content : mapping
    where : str

    Raises
    ------
    InvalidValueError
        If a key is missing or has a value of the wrong type.
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
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidValueError(f"has no usable mapolas ({error})", where, _AGAIN) from error


def _to_surface(entry: Mapping[str, Any]) -> FloatArray:
    """SPC surface minus registered lidar (3,), metres; not the residual of a fit by images."""
    if "surface_residual_m" in entry:
        return _vector(entry["surface_residual_m"])
    return _vector(entry["residual_m"]) if entry["used"] else np.full(3, np.nan)


def _vector(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64).reshape(3)
