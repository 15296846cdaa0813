"""The scale as ``scale.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fusion.estimation.verdict import Cause
from fusion.scaling.fit.joint import ScaleEstimate
from fusion.scaling.fit.observation import PARAMETERS, ScaleObservations
from fusion.scaling.fit.residuals import residuals_json
from fusion.scaling.fit.trends import DayScale
from fusion.scaling.geometry.frames import UnpairedImage
from fusion.scaling.misplacement.check import PlaceCheck
from fusion.scaling.misplacement.crossings import Crossings
from fusion.scaling.misplacement.scans import ScanChecks
from fusion.scaling.pairs.pairs import Pair
from fusion.scaling.shots.shots import ShotComparison
from fusion.scaling.shots.spots import SpotOptions


def scale_json(
    observations: ScaleObservations, estimate: ScaleEstimate, *, mean_radius: float
) -> dict[str, Any]:
    """Content of ``scale.json`` common to pairs and shots; see `keys`.

    Parameters
    ----------
    observations : ScaleObservations
    estimate : ScaleEstimate
    mean_radius : float
        Of the body, metres: the size correction is ε times it.

    Returns
    -------
    dict
        Keys name the units; arrays and NaN are converted to JSON when written.
    """
    fit, ground = estimate.fit, estimate.ground
    sigma, value = fit.sigma, fit.estimate
    return {
        "method": observations.kind,
        "trajectory": observations.trajectory,
        "epsilon": value[0],
        "epsilon_sigma": sigma[0],
        "size_correction_m": value[0] * mean_radius,
        "size_correction_sigma_m": sigma[0] * mean_radius,
        "center_offset_m": value[1:4],
        "center_offset_sigma_m": sigma[1:4],
        "pole_deg": np.degrees(value[4:6]),
        "pole_sigma_deg": np.degrees(sigma[4:6]),
        "prime_meridian_deg": np.degrees(value[6]),
        "prime_meridian_sigma_deg": np.degrees(sigma[6]),
        "range_bias_m": value[7],
        "range_bias_sigma_m": sigma[7],
        "single_sigma_m": fit.sizes.independent,
        "state_sigma_m": fit.sizes.shared[0],
        "day_sigma_m": fit.sizes.shared[1],
        "ground_factor": fit.sizes.shared[2] or None,
        "ground_sigma_m": ground and ground.sigma_m * fit.sizes.shared[2],
        "ground_reach_m": ground and ground.reach_m,
        "residuals": residuals_json(observations, fit),
        "n_used": int(np.count_nonzero(fit.used)),
        "n_rejected": int(np.count_nonzero(~fit.used)),
        "parameters": list(PARAMETERS),
        "covariance": fit.covariance,
        "per_day": [_of_day(day, mean_radius) for day in estimate.days],
        "trends": {name: asdict(trend) for name, trend in estimate.trends.items()},
        "reasons": list(estimate.reasons),
        "converged": fit.converged,
        "reason": fit.reason,
    }


def _of_day(day: DayScale, mean_radius: float) -> dict[str, Any]:
    """Entry of one day."""
    return {
        "day": day.day,
        "n": day.count,
        "epsilon": day.epsilon,
        "epsilon_sigma": day.epsilon_sigma,
        "size_correction_m": day.epsilon * mean_radius,
        "mean_epsilon": day.mean,
        "standard_error": day.standard_error,
    }


_NUMBERS = (
    *("epsilon", "epsilon_sigma", "size_correction_m", "size_correction_sigma_m"),
    *("prime_meridian_deg", "prime_meridian_sigma_deg", "range_bias_m", "range_bias_sigma_m"),
)
_SIZES = (
    *("single_sigma_m", "state_sigma_m", "day_sigma_m"),
    *("ground_factor", "ground_sigma_m", "ground_reach_m"),
)


def unobserved_json(kind: str, trajectory: str, reason: str) -> dict[str, Any]:
    """Content of ``scale.json`` without observations: all numbers null, with the reason.

    Parameters
    ----------
    kind : {"pairs", "shots"}
    trajectory : {"spc", "reference"}
    reason : str
        One clause.
    """
    return {
        **dict.fromkeys(_NUMBERS),
        **dict.fromkeys(("center_offset_m", "center_offset_sigma_m"), [None] * 3),
        **dict.fromkeys(("pole_deg", "pole_sigma_deg"), [None] * 2),
        "method": kind,
        "trajectory": trajectory,
        **dict.fromkeys(_SIZES),
        "residuals": None,
        "n_used": 0,
        "n_rejected": 0,
        "parameters": list(PARAMETERS),
        "covariance": None,
        "per_day": [],
        "trends": {},
        "reasons": [f"nothing is observed: {reason}"],
        "converged": False,
        "reason": reason,
    }


def per_pair(
    pairs: Sequence[Pair],
    left_out: Sequence[UnpairedImage],
    observations: ScaleObservations,
    estimate: ScaleEstimate,
) -> list[dict[str, Any]]:
    """Entries of ``per_pair``: the numbers of each image, or the reason why it is not used.

    `dx_m`, `dy_m` and `dz_m` are the displacement of the lidar from SPC along the bigmap's axes.
    """
    epsilon, sigma = observations.epsilon()
    used, rest = estimate.fit.used, estimate.fit.conditional
    rows: list[dict[str, Any]] = []
    for row, pair in enumerate(pairs):
        frame, match = pair.frame, pair.match
        rows.append(
            {
                "image": frame.image,
                "day": observations.day[row],
                "epsilon": epsilon[row],
                "epsilon_sigma": sigma[row],
                "range_m": frame.range,
                "dx_m": -match.local[0],
                "dy_m": -match.local[1],
                "dz_m": -match.local[2],
                "residual_m": rest[row],
                "correlation": match.correlation,
                "coverage": match.coverage,
                "longitude_deg": np.degrees(observations.longitude[row]),
                "local_time_h": frame.local_time_h,
                "emission_deg": frame.emission_deg,
                "incidence_deg": frame.incidence_deg,
                "used": bool(used[row]),
                "reason": "" if used[row] else "disagrees with the other pairs",
                "cause": None if used[row] else Cause.OUTLIER,
            }
        )
    return sorted([*rows, *unused_pairs(left_out)], key=lambda entry: str(entry["image"]))


def unused_pairs(left_out: Sequence[UnpairedImage]) -> list[dict[str, Any]]:
    """Entries of ``per_pair`` for the images without a pair, with the reason."""
    return [
        {"image": item.image, "used": False, "reason": item.reason, "cause": item.cause}
        for item in left_out
    ]


def per_shot(comparison: ShotComparison, estimate: ScaleEstimate) -> list[dict[str, Any]]:
    """Entries of ``per_shot``: the numbers of each shot."""
    observations, fit = comparison.observations, estimate.fit
    epsilon, _ = observations.epsilon()
    return [
        {
            "scan": observations.label[row],
            "day": observations.day[row],
            "epsilon": epsilon[row],
            "range_m": observations.range[row],
            "sigma_m": np.sqrt(observations.covariance[row, 0, 0]),
            "residual_m": observations.value[row, 0],
            "fitted_residual_m": fit.residual[row, 0],
            "longitude_deg": np.degrees(observations.longitude[row]),
            "used": bool(fit.used[row]),
        }
        for row in range(len(observations))
    ]


def assumed_json(spots: SpotOptions) -> dict[str, Any]:
    """Entry ``assumed``: assumptions about single shots; null if unknown."""
    return {
        "footprint_mrad": 1e3 * spots.footprint_rad or None,
        "pointing_sigma_mrad": 1e3 * spots.pointing_sigma_rad or None,
        "range_sigma_m": spots.range_sigma_m,
    }


def place_json(check: PlaceCheck) -> dict[str, Any]:
    """Entry ``longitude_check``: the fit of the shots at their stated positions and elsewhere.

    `best_turn_deg` is null if the best place is not a rotation about Z; `best` describes it.
    """
    return {
        "statistic": "scatter of range residuals here and at the best of many places, paired",
        "n_shots": check.count,
        "scatter_here_m": check.here_m,
        "scatter_best_m": check.best_m,
        "best": str(check.best),
        "best_turn_deg": check.best.signed_deg if check.best.about_z else None,
        "p_value": check.p_value,
        "p_paired": check.paired,
        "p_noise": check.noise,
        "n_independent": check.independent,
        "places_tried": check.tried,
        "misfit": check.misfit,
        "scatter_wrong_m": check.usual_m,
        "wrong_places": check.wrong,
        "rivals": check.as_good,
    }


def scan_places_json(places: ScanChecks, crossings: Crossings) -> dict[str, Any]:
    """Entry ``scan_check``: the fit of single scans at their stated positions, their agreement.

    `per_scan` is empty if it was not tested: with one scan, or if all shots fit elsewhere.
    """
    return {
        "within_m": crossings.within_m,
        "between_m": crossings.between_m,
        "neighbours": crossings.pairs,
        "neighbours_apart_m": crossings.apart_m,
        "per_scan": [
            {
                "scans": list(names),
                "n_shots": check.count,
                "scatter_here_m": check.here_m,
                "scatter_best_m": check.best_m,
                "best": str(check.best),
                "p_value": check.p_value,
                "misfit": misfit,
            }
            for names, check, misfit in zip(
                places.names, places.checks, places.misfits, strict=True
            )
        ],
    }
