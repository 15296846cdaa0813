"""A given transform applied to mapolas without a fit, with the residuals to SPC."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.registration.fit import MatchedMapolas
from fusion.registration.fit.reasons import inseparable
from fusion.registration.fit.scan_errors import mapola_shifts
from fusion.registration.results.fitted import RegisteredPositions, per_mapola_json, per_scan_json
from fusion.registration.results.read import GivenRegistration
from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import mad

# Largest distance, metres, of a mapola from the position that the file gives for it.
_SAME_PLACE_M = 1e-3


def applied_json(
    given: GivenRegistration,
    mapolas: MatchedMapolas,
    shares: FloatArray,
    *,
    reject: float,
) -> dict[str, Any]:
    """Content of ``registration.json`` for a transform that was given.

    Parameters
    ----------
    given : GivenRegistration
    mapolas : MatchedMapolas
        With matches from :meth:`GivenRegistration.referred`.
    shares : (N, S) ndarray
        Shares of their returns, by ``mapolas.scans.names``.
    reject : float
        Matches with residuals more than this many standard deviations from the median are not used.
    """
    placed = _placed(given, mapolas, shares, reject)
    own = [given.scans.get(name, np.zeros((3, 3))) for name in mapolas.scans.names]
    used = int(np.count_nonzero(placed.used))
    return {
        **given.known.numbers(),
        "residual_std_m": np.std(placed.residual[placed.used], axis=0),
        "residual_mean_m": np.mean(placed.residual[placed.used], axis=0),
        "n_used": used,
        "n_rejected": len(mapolas.matches) - used,
        "maplet_sigma_m": None,
        "scan_sigma_m": None,
        "landmarks": None,
        "per_scan": per_scan_json(mapolas.scans, np.array(own).reshape(-1, 9)[:, 3:]),
        "iterations": 0,
        "converged": True,
        "reason": "applied, not fitted",
        "per_mapola": per_mapola_json(mapolas, placed),
        "tests": None,
        "stability": None,
        "inverse": given.known.inverse().numbers(),
        "reasons": _reasons(given, mapolas),
    }


def _placed(
    given: GivenRegistration, mapolas: MatchedMapolas, shares: FloatArray, reject: float
) -> RegisteredPositions:
    """Positions of the mapolas by the transform and by the file's displacements of scans."""
    matches = mapolas.matches
    centers = np.array([match.center for match in matches])
    shift = _shifts(given, mapolas.scans.names, shares, centers)
    target = centers + np.array([match.displacement for match in matches])
    residual = target - given.known.transform.apply(centers) - shift
    # The file does not give the remaining errors of scans: their prior size is used.
    covariance = given.known.position_covariance(centers) + mapolas.residual_covariance
    covariance += mapolas.effects @ mapolas.effects.transpose(0, 2, 1)
    for number, match in enumerate(matches):
        center, own = given.covariances.get(match.name, (np.full(3, np.inf), covariance[number]))
        if np.linalg.norm(center - match.center) < _SAME_PLACE_M:
            covariance[number] = own
    used = _agreeing(mapolas, residual, reject)
    surface = np.where(used[:, None], residual, np.nan)
    return RegisteredPositions(shift, residual, surface, covariance, used)


def _shifts(
    given: GivenRegistration, names: tuple[str, ...], shares: FloatArray, centers: FloatArray
) -> FloatArray:
    """Displacements (N, 3), metres, of mapolas by the file's displacements of scans."""
    known = [k for k, name in enumerate(names) if name in given.scans]
    if not known:
        return np.zeros(centers.shape)
    entries = np.stack([given.scans[names[k]] for k in known])
    displacement = entries[:, 1:].reshape(-1, 6)
    return mapola_shifts(entries[:, 0], displacement, shares[:, known], centers)


def _agreeing(mapolas: MatchedMapolas, residual: FloatArray, reject: float) -> BoolArray:
    """Mask (N,) of matches that agree with the others, up to a common offset from SPC."""
    usable = mapolas.usable
    off = residual - np.median(residual[usable], axis=0)
    own = np.array([match.covariance for match in mapolas.matches])
    spread = own[usable] + np.diag(mad(residual[usable], axis=0) ** 2)
    solved = np.linalg.solve(spread, off[usable][..., None])[..., 0]
    agreeing = usable.copy()
    agreeing[usable] = np.einsum("ni,ni->n", off[usable], solved) <= 3.0 * reject**2
    return agreeing


def _reasons(given: GivenRegistration, mapolas: MatchedMapolas) -> list[str]:
    """Notes about a transform that was given."""
    texts = ["transform: applied as given, nothing was fitted and nothing tested"]
    if given.known.is_exact:
        texts.append("transform: its file has no covariance, and it counts as exact")
    missing = [name for name in mapolas.scans.names if name not in given.scans]
    if given.scans and missing:
        texts.append(
            f"scans: {len(missing)} of {len(mapolas.scans.names)} are not in the file; they remain "
            "as adjusted"
        )
    return texts + inseparable(given.known.parameters, given.known.covariance)
