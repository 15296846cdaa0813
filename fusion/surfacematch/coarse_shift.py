"""The best whole-cell shift of one surface against another, and its alternatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from fusion.surfacematch.alignment import Fields
from spcola.arrays import FloatArray
from spcola.grids.correlation import shift_variances

APART = 3.0
"""Displacements further apart than this, cells, count as different solutions."""
AREA = 60.0
"""Approximate area over which differences are correlated, cells."""


class CoarseShift(NamedTuple):
    """The best whole-cell shift (2,), x and y, cells, and other minima about as good."""

    start: FloatArray
    alternatives: list[FloatArray]


def coarse_shift(fields: Fields, *, reach: int, ambiguity: float) -> CoarseShift:
    """Find the best whole-cell shift, and up to three others about as good.

    Parameters
    ----------
    fields : Fields
    reach : int
        Largest shift along either axis, cells.
    ambiguity : float
        An alternative is another local minimum of the difference's variance, at most this factor
        above the best one, or at most a quarter of the median over all shifts.
    """
    weight = np.where(fields.fixed_known, fields.sigma**-2, 0.0)
    variance = shift_variances(
        fields.moving, fields.moving_known, fields.fixed, weight, reach=reach
    )
    if not np.isfinite(variance).any():
        # A grid of a few points: no shift leaves enough common ones, which the fit then reports.
        return CoarseShift(np.zeros(2), [])
    points = np.count_nonzero(fields.moving_known & fields.fixed_known)
    best = _likeliest(variance, points / AREA)
    start = np.array([best[1] - reach, best[0] - reach], dtype=np.float64)
    depth = max(
        ambiguity * _valley_floor(variance, *best),
        0.25 * float(np.nanmedian(variance)),
    )
    valleys = np.argwhere(ndimage.minimum_filter(variance, size=5, mode="nearest") == variance)
    found = [
        (_valley_floor(variance, row, column), column - reach, row - reach)
        for row, column in valleys.tolist()
        if np.hypot(row - best[0], column - best[1]) > APART
    ]
    alternatives = sorted(other for other in found if other[0] < depth)[:3]
    return CoarseShift(start, [np.array(other[1:], dtype=np.float64) for other in alternatives])


def _likeliest(variance: FloatArray, count: float) -> tuple[int, int]:
    """Row and column of the shift of greatest posterior probability.

    The cost is ``n/2 ln(variance)`` for n = `count` independent differences, plus a Gaussian prior
    as wide as the capture range: over flat ground, or along a ridge, many variances are about
    equal and their minimum has no meaning.
    """
    reach = variance.shape[0] // 2
    step = np.arange(-reach, reach + 1) / reach
    with np.errstate(divide="ignore"):
        cost = 0.5 * count * np.log(variance) + 0.5 * (step[:, None] ** 2 + step[None, :] ** 2)
    row, column = np.unravel_index(int(np.nanargmin(cost)), cost.shape)
    return int(row), int(column)


def _valley_floor(variance: FloatArray, row: int, column: int) -> float:
    """Lowest variance near a whole-cell minimum, by a parabola along each axis.

    Between whole cells a steep valley can be far deeper than at any of them.
    """
    middle = float(variance[row, column])
    floor = middle
    for before, after in (
        ((row - 1, column), (row + 1, column)),
        ((row, column - 1), (row, column + 1)),
    ):
        if min(before) < 0 or max(after) >= len(variance):
            continue
        left, right = float(variance[before]), float(variance[after])
        bend = left - 2.0 * middle + right
        if np.isfinite(bend) and bend > 0:
            floor -= (right - left) ** 2 / (8.0 * bend)
    return max(floor, 0.0)
