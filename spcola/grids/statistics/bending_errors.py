"""How much a gridded surface bends, and what that does to the mean height of a cell."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from spcola.arrays import FloatArray

CELL_SHARE = 1.0 / 24.0
"""Of its bending, the height by which a quadratic surface's mean over the cell around a grid point
exceeds the height there: ∫ ½ (h_xx x² + h_yy y²) over the unit square."""

BENDING_NOISE = 4.0
"""Variance of :func:`bending` for independent heights of variance 1."""

BENDING_RANGE_NOISE = 39.7
"""Mean square of :func:`bending_range` for independent normal heights of variance 1 (simulated)."""


def bending(height: FloatArray) -> FloatArray:
    """Return ``h_xx + h_yy`` of the quadratic surface fitted to the 3 × 3 heights around a point.

    Least squares, so that noise makes :data:`BENDING_NOISE` times its variance of it, where second
    differences along the two axes would make 20 times.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.

    Returns
    -------
    (R, C) ndarray
        Metres (per square grid step); positive in hollows. NaN at the border and beside a gap.
    """
    bend = np.full(height.shape, np.nan)
    center = height[1:-1, 1:-1]
    sides = height[2:, 1:-1] + height[:-2, 1:-1] + height[1:-1, 2:] + height[1:-1, :-2]
    corners = height[2:, 2:] + height[:-2, 2:] + height[2:, :-2] + height[:-2, :-2]
    bend[1:-1, 1:-1] = (2.0 * corners - sides - 4.0 * center) / 3.0
    return bend


def bending_range(height: FloatArray) -> FloatArray:
    """Return by how much :func:`bending` differs within the 3 × 3 points around each, metres.

    At the edge of a boulder it is what the bending of one point leaves unsaid. 0 where at most one
    of them is known.
    """
    bend = bending(height)
    known = np.isfinite(bend)
    most = maximum_filter(np.where(known, bend, -np.inf), size=3)
    least = minimum_filter(np.where(known, bend, np.inf), size=3)
    return np.maximum(most - least, 0.0)
