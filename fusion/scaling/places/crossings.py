"""Whether single scans agree with each other where they lie over the same ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fusion.scaling.geometry.placing import KnownPlace
from fusion.scaling.places.fits import PlaceFit
from fusion.scaling.shots.shots import ShotComparison
from spcola.arrays import FloatArray
from spcola.math.robust import mad

# Pairs of shots of which a scatter is taken, of either kind.
_FEWEST_PAIRS = 100
# Scans of fewer shots leave too little after a fit of their own.
_FEWEST_SHOTS = 30


@dataclass(frozen=True)
class Crossings:
    """Residuals of neighbouring shots of one scan, and of different scans.

    Errors of the shape are those of a place: all scans have them there. What residuals of
    different scans differ by more than those of one scan at the same distance is no error of the
    shape.

    Attributes
    ----------
    within_m, between_m : float
        Robust scatter of differences of neighbours' residuals, over √2, metres; NaN where there
        are fewer than a hundred pairs of either kind.
    pairs : int
        Pairs of different scans.
    apart_m : float
        Distance up to which shots are neighbours, metres.
    """

    within_m: float = float("nan")
    between_m: float = float("nan")
    pairs: int = 0
    apart_m: float = float("nan")


def compare_crossings(
    compared: Sequence[ShotComparison], prior: FloatArray, known: KnownPlace
) -> Crossings:
    """Compare residuals of scans over the same ground, after a fit of each scan of its own.

    Parameters
    ----------
    compared : sequence of ShotComparison
        One of each scan.
    prior : (8,) ndarray
        Of the parameters of the fits: what is wrong with the position of a scan is no scatter.
    known : KnownPlace
        Where the shots were compared, and about which the priors lie.

    Returns
    -------
    Crossings
    """
    points, rests, numbers = [], [], []
    for number, one in enumerate(compared):
        seen = one.observations
        if len(seen) >= _FEWEST_SHOTS:
            value = seen.value[:, 0] - seen.design()[:, 0] @ known.parameters
            fit = PlaceFit(one.met, value, seen.design()[:, 0])
            points.append(seen.point)
            rests.append(fit.rest(prior)[one.met])
            numbers.append(np.full(len(seen), number))
    if len(points) < 2:
        return Crossings()
    # As far apart as neighbours of one scan are.
    apart = float(np.median([np.median(_nearest(part)) for part in points]))
    first, second = cKDTree(np.concatenate(points)).query_pairs(apart, output_type="ndarray").T
    rest, scan = np.concatenate(rests), np.concatenate(numbers)
    less, same = (rest[first] - rest[second]) / np.sqrt(2.0), scan[first] == scan[second]
    pairs = int(np.count_nonzero(~same))
    if min(pairs, int(np.count_nonzero(same))) < _FEWEST_PAIRS:
        return Crossings(pairs=pairs, apart_m=apart)
    return Crossings(float(mad(less[same])), float(mad(less[~same])), pairs, apart)


def _nearest(points: FloatArray) -> FloatArray:
    """Distance of each of N points to the nearest other one (N,), metres."""
    distance = np.asarray(cKDTree(points).query(points, 2)[0])
    return distance[:, 1]
