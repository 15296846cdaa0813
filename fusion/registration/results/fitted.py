"""The content of ``registration.json`` for a fitted transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.estimation import influence
from fusion.estimation.verdict import Cause
from fusion.registration.fit import MatchedMapolas, Registration, ScanErrorPatterns
from fusion.registration.fit.reasons import registration_reasons
from fusion.registration.fit.significance import departures_json
from fusion.registration.fit.stability import stability_json
from fusion.registration.transform import KnownTransform
from fusion.surfacematch import Match
from spcola.arrays import BoolArray, FloatArray

DISAGREES = "disagrees with the other mapolas"
"""Reason why a mapola that matches is not used."""


def registration_json(
    registration: Registration, mapolas: MatchedMapolas, *, scale_partials: bool = False
) -> dict[str, Any]:
    """Content of ``registration.json``; its keys: :mod:`fusion.registration.results.keys`.

    Parameters
    ----------
    registration : Registration
        Fitted to the usable ones of `mapolas`, in their order.
    mapolas : MatchedMapolas
    scale_partials : bool
        Add the derivative of the scale of a similarity by the displacement of each match.

    Returns
    -------
    dict
        Keys name the units; arrays and NaN are converted to JSON when written.
    """
    fit, scans = registration.fit, mapolas.scans
    known = KnownTransform(registration.model, registration.transform, registration.covariance)
    by_scans = fit.sizes.shared[0] * mapolas.effects[mapolas.usable]
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
        "tests": departures_json(registration),
        "stability": stability_json(registration),
        "inverse": known.inverse().numbers(),
        "reasons": registration_reasons(registration),
    }
    if registration.model == "affine":
        found = content["tests"]["strain"]
        content |= {key: found[key] for key in ("strain", "strain_sigma")}
    if scale_partials and registration.model == "similarity":
        partials = _scale_partials(registration, mapolas)
        for entry, partial in zip(content["per_mapola"], partials, strict=True):
            entry["scale_per_m"] = partial
    return content


def _scale_partials(registration: Registration, mapolas: MatchedMapolas) -> FloatArray:
    """Derivative (N, 3), 1/m, of the scale by each match's displacement; 0 where not used."""
    moved = np.zeros((len(mapolas.matches), 3))
    of_all = influence(registration.observations, registration.fit)
    moved[mapolas.usable] = of_all[registration.parameters.index("scale")]
    return moved


def per_scan_json(scans: ScanErrorPatterns, displacement: FloatArray) -> list[dict[str, Any]]:
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
class RegisteredPositions:
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


def _placed(registration: Registration, mapolas: MatchedMapolas) -> RegisteredPositions:
    """Registered positions of the mapolas by a fit."""
    centers = np.array([match.center for match in mapolas.matches])
    residual, used = np.full(centers.shape, np.nan), mapolas.usable
    residual[used] = registration.fit.conditional
    used[used] = registration.fit.used
    shift = mapolas.effects @ registration.strengths
    moved = np.array([match.displacement for match in mapolas.matches]).reshape(-1, 3)
    surface = centers + moved - registration.transform.apply(centers) - shift
    surface[~used] = np.nan
    return RegisteredPositions(
        shift=shift,
        residual=residual,
        surface=surface,
        covariance=registration.position_covariance(centers, mapolas.effects)
        + mapolas.residual_covariance,
        used=used,
    )


def per_mapola_json(mapolas: MatchedMapolas, placed: RegisteredPositions) -> list[dict[str, Any]]:
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
