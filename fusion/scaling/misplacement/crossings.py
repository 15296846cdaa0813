"""Agreement of scans over the same ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fusion.scaling.geometry.placement import LidarPlacement
from fusion.scaling.misplacement.fit import PlaceFit
from fusion.scaling.shots.shots import ShotComparison
from spcola.arrays import FloatArray
from spcola.math.robust import mad

# Fewest pairs of shots for a scatter, within one scan and between scans.
_FEWEST_PAIRS = 100
# Scans with fewer shots have too few degrees of freedom after a fit of their own.
_FEWEST_SHOTS = 30


@dataclass(frozen=True)
class Crossings:
    """Differences of residuals of neighbouring shots, within one scan and between scans.

    Errors of the shape are common to all scans at a place. If residuals of different scans differ
    by more than those of one scan at the same distance, the cause is not the shape.

    Attributes
    ----------
    within_m, between_m : float
        Robust standard deviation of differences of neighbours' residuals, over √2, metres; NaN with
        fewer than a hundred pairs within scans or between scans.
    pairs : int
        Number of pairs between scans.
    apart_m : float
        Largest distance of neighbours, metres.
    """

    within_m: float = float("nan")
    between_m: float = float("nan")
    pairs: int = 0
    apart_m: float = float("nan")


def compare_crossings(
    compared: Sequence[ShotComparison], prior: FloatArray, known: LidarPlacement
) -> Crossings:
    """Compare residuals of scans over the same ground, after a separate fit to each scan.

    Parameters
    ----------
    compared : sequence of ShotComparison
        One for each scan.
    prior : (8,) ndarray
        Prior sigmas of the fits, which remove the error of each scan's position.
    known : LidarPlacement
        Placement at which the shots were compared, the centre of the priors.
    """
    points, rests, numbers = [], [], []
    for number, one in enumerate(compared):
        shots = one.observations
        if len(shots) >= _FEWEST_SHOTS:
            value = shots.value[:, 0] - shots.design()[:, 0] @ known.parameters
            fit = PlaceFit(one.hits, value, shots.design()[:, 0])
            points.append(shots.point)
            rests.append(fit.rest(prior)[one.hits])
            numbers.append(np.full(len(shots), number))
    if len(points) < 2:
        return Crossings()
    # The typical distance of neighbours within one scan.
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
