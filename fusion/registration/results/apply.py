"""A given transform applied to mapolas without a fit, with the residuals to SPC."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.registration.fit.fit import LIDAR_FRAME, SPC_FRAME
from fusion.registration.fit.known import KnownTransform, known_transform
from fusion.registration.fit.reasons import inseparable
from fusion.registration.results.scans import mapola_shifts
from fusion.registration.results.summary import (
    MatchedMapolas,
    Placed,
    per_mapola_json,
    per_scan_json,
    transform_of,
)
from fusion.surfacematch import Match
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.math import Affine
from spcola.math.robust import mad

_DO = "give a registration.json, or JSON with model, scale, rotation_deg and translation_m"
# Largest distance, metres, of a mapola from the position that the file gives for it.
_SAME_PLACE_M = 1e-3


@dataclass(frozen=True, eq=False)
class GivenRegistration:
    """The transform from lidar to SPC coordinates that a file gives.

    Attributes
    ----------
    known : KnownTransform
        From lidar to SPC coordinates.
    scans : mapping of str to (2, 3) or (3, 3) ndarray
        Addition to the adjustment of a scan: rows are its centre, displacement (metres) and
        rotation vector (radians).
    covariances : mapping of str to (center, covariance)
        Mapolas of the file: centre (3,) and covariance (3, 3), m², of the position.
    """

    known: KnownTransform
    scans: Mapping[str, FloatArray]
    covariances: Mapping[str, tuple[FloatArray, FloatArray]]

    def moved(self, grid: MapletGrid) -> MapletGrid:
        """Return the grid of a mapola moved by the transform alone."""
        return grid.moved(self.known.transform)

    def referred(self, match: Match, grid: MapletGrid) -> Match:
        """Convert a match of the moved grid to one of the mapola's own `grid`."""
        path = self.moved(grid).center - grid.center
        return replace(match, center=grid.center, displacement=match.displacement + path)


def given_registration(
    content: Mapping[str, Any], where: str, *, inverse: bool = False
) -> GivenRegistration:
    """Read a transform from ``registration.json``, or from JSON with the transform alone.

    Parameters
    ----------
    content : mapping
        `model`, `scale`, `rotation_deg` [3], `translation_m` [3] (of an affine map `matrix`);
        optional: `covariance`, and `per_scan` and `per_mapola` of a registration.
    where : str
        Name of the file, for errors.
    inverse : bool
        True if the file takes SPC to lidar coordinates. Its scans and mapolas are then ignored.

    Raises
    ------
    InvalidValueError
        If the content is not valid.
    """
    transform = transform_of(content, where, do=_DO)
    known = known_transform(content, transform, where, do=_DO)
    if inverse:
        back = known.inverse()
        named = Affine(back.transform.matrix, back.transform.translation, SPC_FRAME, LIDAR_FRAME)
        return GivenRegistration(replace(back, transform=named), {}, {})
    try:
        scans = {
            str(entry["scan"]): np.array(
                [entry["center_m"], entry["offset_m"], np.radians(entry["rotation_deg"])], float
            ).reshape(3, 3)
            for entry in content.get("per_scan") or ()
        }
        covariances = {
            str(entry["name"]): (
                np.array(entry["center_m"], float).reshape(3),
                np.array(entry["position_covariance_m2"], float).reshape(3, 3),
            )
            for entry in content.get("per_mapola") or ()
        }
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InvalidValueError(
            f"has no usable scans or mapolas ({error})",
            where,
            "remove them: the transform alone is enough",
        ) from error
    return GivenRegistration(known, scans, covariances)


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
) -> Placed:
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
    return Placed(shift, residual, surface, covariance, used)


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
