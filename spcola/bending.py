"""How much a gridded surface bends from point to point."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray

# Standard deviations up to which bending is taken for noise.
_CHANCE = 3.0


def bending(height: FloatArray) -> FloatArray:
    """Return the size of the sum of both second differences of a surface.

    Four times the distance of each point from the mean of its four neighbours.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.

    Returns
    -------
    (R, C) ndarray
        Metres; NaN at the border and beside a gap.
    """
    bend = np.full(height.shape, np.nan)
    around = height[2:, 1:-1] + height[:-2, 1:-1] + height[1:-1, 2:] + height[1:-1, :-2]
    bend[1:-1, 1:-1] = np.abs(around - 4.0 * height[1:-1, 1:-1])
    return bend


def significant_bending(height: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return what of :func:`bending` noise does not explain, in quadrature (R, C), metres.

    Of independent heights with `sigma` (R, C) the bending has the variance of the four neighbours
    and 16 times that of the point itself; what is within three standard deviations of that is
    none. 0 where nothing is known.
    """
    noise = sigma**2
    chance = np.zeros(height.shape)
    chance[1:-1, 1:-1] = noise[2:, 1:-1] + noise[:-2, 1:-1] + noise[1:-1, 2:] + noise[1:-1, :-2]
    excess = bending(height) ** 2 - _CHANCE**2 * (chance + 16.0 * noise)
    return np.sqrt(np.fmax(np.nan_to_num(excess), 0.0))
