"""The registration as other programs read it (``registration.json``), and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fusion.registration.fit import (
    LIDAR_FRAME,
    SPC_FRAME,
    Registration,
    shear_significance,
    similarity_numbers,
    transform_partials,
)
from fusion.registration.match import Match
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.similarity import Affine, Similarity


def registration_json(
    registration: Registration,
    matches: Sequence[Match],
    *,
    blur_cells: float,
    scans: Sequence[str],
) -> dict[str, Any]:
    """Content of ``registration.json`` (DESIGN: keys that other programs read).

    Parameters
    ----------
    registration : Registration
        Fitted to the usable ones of `matches`, in their order.
    matches : sequence of Match
        All matches, the unusable ones too.
    blur_cells : float
        Blur of the SPC surface against the lidar, cells, that was applied.
    scans : sequence of str
        Names of the scans whose shared error was estimated.

    Returns
    -------
    dict
        Units stand in the keys; arrays and NaN are turned into JSON where it is written.
    """
    scale, scale_sigma, rotation, rotation_sigma = similarity_numbers(registration)
    fit = registration.fit
    sigma = np.sqrt(np.diag(registration.covariance))
    effects = fit.effects[0].reshape(-1, 3)
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
        "n_rejected": len(matches) - int(np.count_nonzero(fit.used)),
        "parameters": list(registration.parameters),
        "covariance": registration.covariance,
        "maplet_sigma_m": fit.sizes.independent,
        "scan_sigma_m": fit.sizes.shared[0],
        "per_scan": [
            {"scan": name, "offset_m": offset} for name, offset in zip(scans, effects, strict=True)
        ],
        "blur_cells": blur_cells,
        "iterations": registration.iterations,
        "converged": fit.converged,
        "reason": fit.reason,
        "per_mapola": _per_mapola(registration, matches),
    }
    if registration.model == "affine":
        content["matrix"] = registration.transform.matrix
        strain, strain_sigma = shear_significance(registration) or (None, None)
        content["strain"], content["strain_sigma"] = strain, strain_sigma
    return content


def _per_mapola(registration: Registration, matches: Sequence[Match]) -> list[dict[str, Any]]:
    """One entry for each mapola: what was found, and why it was not used if it was not."""
    fit, entries, row = registration.fit, [], 0
    for match in matches:
        residual: FloatArray = np.full(3, np.nan)
        reason, used = match.reason, False
        if match.usable:
            residual, used = fit.residual[row], bool(fit.used[row])
            reason = "" if used else "disagrees with the other mapolas"
            row += 1
        entries.append(
            {
                "name": match.name,
                "center_m": match.center,
                "displacement_m": match.displacement,
                "sigma_m": np.sqrt(np.diag(match.covariance)),
                "residual_m": residual,
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


def position_covariance(content: Mapping[str, Any], points: FloatArray, where: str) -> FloatArray:
    """Covariance (N, 3, 3), m², of registered positions of `points` (N, 3), lidar coordinates.

    The transform's own uncertainty, out of ``registration.json``.

    Raises
    ------
    InvalidValueError
        If the covariance is missing or does not fit the model.
    """
    similarity = transform_of(content, where).nearest_similarity()
    design = transform_partials(content["model"], similarity, points, np.zeros(3))
    try:
        covariance = np.array(content["covariance"], dtype=np.float64)
        return np.einsum("nip,pq,njq->nij", design, covariance, design)
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(
            f"has no usable covariance ({error})", where, "remove it and register again"
        ) from error
