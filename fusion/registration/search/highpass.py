"""Short-wave relief, by which two bodies of similar shape differ."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fusion.registration.search.directions import Directions, cell_centers
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.math.robust import mad

LONGEST_DEG = 6.0
"""Standard deviation, degrees, of the Gaussian mean that is subtracted from the radii."""
SHORTEST_DEG = 1.0
"""Standard deviation, degrees, of the Gaussian mean that reduces the surface's noise."""
_COARSE = 32
_FINE_DEG = 2.0
_NEAREST = 3
_REACH_DEG = 3.0
_NEAREST_DEG = 0.2
_CLIPPED = 3.0
_LEAST = 20


class ShortRelief:
    """Relief of a surface at wavelengths below some twenty degrees."""

    def __init__(self, surface: Directions) -> None:
        long = surface.coarser(_COARSE).smoothed(cell_centers(_COARSE), LONGEST_DEG)
        centers = cell_centers(_COARSE)[np.isfinite(long)]
        smooth = Directions.of(centers * np.exp(long[np.isfinite(long)])[:, None], _COARSE)
        self._long = smooth.smoothed(surface.unit, _FINE_DEG)
        self._short = surface.smoothed(surface.unit, SHORTEST_DEG) - self._long
        known = np.isfinite(self._short)
        self._long, self._short = self._long[known], self._short[known]
        self._tree = cKDTree(surface.unit[known])

    def correlation(self, points: FloatArray) -> float:
        """Return the correlation of the relief with that of points (N, 3) placed on the surface.

        0 if too few of them are on it. Outliers are clipped at three standard deviations.
        """
        row, weight, relief = self._relief_of(points)
        return _correlation(relief, np.sum(weight * self._short[row], axis=1))

    def elsewhere(self, points: FloatArray, turns: FloatArray) -> FloatArray:
        """Return the correlations (K,) of the points' relief with that of other places.

        These are the images of the points under `turns` (K, 3, 3), mirrored or not; NaN if the
        surface is not known for most of the images.
        """
        _, _, relief = self._relief_of(points)
        units = points[self._near(points)[0]]
        found = np.full(len(turns), np.nan)
        for k, turn in enumerate(turns):
            near, row, weight = self._near(units @ turn.T)
            if 2 * np.count_nonzero(near) >= len(units) >= _LEAST:
                short = np.sum(weight * self._short[row], axis=1)
                found[k] = _correlation(relief[near], short)
        return found

    def _near(self, points: FloatArray) -> tuple[BoolArray, IntArray, FloatArray]:
        """Mask of the points that have cells around, and the cells and weights of these."""
        units = points / np.linalg.norm(points, axis=1, keepdims=True)
        found = self._tree.query(units, k=_NEAREST, distance_upper_bound=np.radians(_REACH_DEG))
        away, row = np.asarray(found[0]), np.asarray(found[1])
        near = np.isfinite(away).all(axis=1)
        weight = 1.0 / (away[near] ** 2 + np.radians(_NEAREST_DEG) ** 2)
        weight /= weight.sum(axis=1, keepdims=True)
        return near, row[near], weight

    def _relief_of(self, points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Cells, weights and relief of the points for which the surface is known."""
        near, row, weight = self._near(points)
        log_radius = np.log(np.linalg.norm(points[near], axis=1))
        return row, weight, log_radius - np.sum(weight * self._long[row], axis=1)


def _correlation(one: FloatArray, other: FloatArray) -> float:
    if len(one) < _LEAST:
        return 0.0
    one, other = _clipped(one), _clipped(other)
    both = np.sqrt(np.sum(one**2) * np.sum(other**2))
    return float(np.sum(one * other) / both) if both > 0.0 else 0.0


def _clipped(values: FloatArray) -> FloatArray:
    """Values clipped at a few robust standard deviations, less their mean."""
    off = values - np.median(values)
    limit = _CLIPPED * float(mad(off))
    clipped = np.clip(off, -limit, limit)
    return clipped - clipped.mean()
