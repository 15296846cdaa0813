"""Bending of a gridded surface, and its effect on the mean height of a cell."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

from spcola.arrays import FloatArray

__all__ = [
    "BENDING_NOISE",
    "BENDING_RANGE_NOISE",
    "CELL_SHARE",
    "bending",
    "bending_around",
    "bending_range",
    "blurred",
]

CELL_SHARE = 1.0 / 24.0
"""Factor from bending to the difference between a quadratic surface's mean over the cell around a
grid point and its height there: ∫ ½ (h_xx x² + h_yy y²) over the unit square."""

BENDING_NOISE = 4.0
"""Variance of :func:`bending` for independent heights of variance 1."""

BENDING_RANGE_NOISE = 39.7
"""Mean square of :func:`bending_range` for independent normal heights of variance 1 (simulated)."""


def bending(height: FloatArray) -> FloatArray:
    """Return ``h_xx + h_yy`` of the quadratic surface fitted to the 3 × 3 heights around a point.

    Least squares, so that the variance due to noise is :data:`BENDING_NOISE` times that of the
    heights; second differences along the two axes would make 20 times.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.

    Returns
    -------
    (R, C) ndarray
        Metres (per square grid step); positive in hollows. NaN at the border and next to a gap.
    """
    bend = np.full(height.shape, np.nan)
    center = height[1:-1, 1:-1]
    sides = height[2:, 1:-1] + height[:-2, 1:-1] + height[1:-1, 2:] + height[1:-1, :-2]
    corners = height[2:, 2:] + height[:-2, 2:] + height[2:, :-2] + height[:-2, :-2]
    bend[1:-1, 1:-1] = (2.0 * corners - sides - 4.0 * center) / 3.0
    return bend


def bending_range(height: FloatArray) -> FloatArray:
    """Return the range of :func:`bending` within the 3 × 3 points around each point, metres.

    `height` (R, C) is as there.

    At the edge of a boulder it shows bending that a single point misses. 0 where at most one of
    them is known.
    """
    bend = bending(height)
    known = np.isfinite(bend)
    most = maximum_filter(np.where(known, bend, -np.inf), size=3)
    least = minimum_filter(np.where(known, bend, np.inf), size=3)
    return np.maximum(most - least, 0.0)


# Largest variance of a blur, squared grid steps. With more of it heights that alternate from point
# to point would change their signs, and rounds that look for the surface would diverge.
_MOST_BLUR = 1.0 / 3.0


def blurred(height: FloatArray, variance: FloatArray | None) -> FloatArray:
    """Return means of a surface about its points, metres: of a quadratic one about each.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres, all known, at least 3 × 3; at the border it bends as next to it.
    variance : (R, C) ndarray, optional
        Along each axis, of what the mean is over, squared grid steps: 1/12 of a cell; more than 1/3
        counts as 1/3. Without it the heights themselves are returned.
    """
    if variance is None:
        return height
    bend = np.pad(bending(height)[1:-1, 1:-1], 1, mode="edge")
    means: FloatArray = height + 0.5 * np.minimum(variance, _MOST_BLUR) * bend
    return means


def bending_around(height: FloatArray) -> FloatArray:
    """Return the root mean square of :func:`bending` over the 3 × 3 points around each, metres.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres, all known; beyond the border the surface goes on as it comes.
    """
    bend = bending(np.pad(height, 2, mode="reflect", reflect_type="odd"))[1:-1, 1:-1]
    square = uniform_filter(bend**2, 3)[1:-1, 1:-1]
    return np.sqrt(np.maximum(square, 0.0))
