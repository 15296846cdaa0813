"""From the mean heights of cells to heights at grid points.

The slope-corrected median of a cell [36] is the height at its grid point where the ground is a
plane. Where it bends, the returns of the cell tell the mean over it: the top of a boulder comes out
too low, the foot of it too high.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter

from lidar.gridding.mapola import Mapola
from spcola.arrays import FloatArray
from spcola.grids.statistics import (
    BENDING_NOISE,
    BENDING_RANGE_NOISE,
    CELL_SHARE,
    bending,
    bending_range,
)

# Width, in cells, of the neighbourhood that tells how much the ground bends.
_AROUND = 5
# Noise makes more than so many times its mean square in a few places of a hundred.
_CHANCE = 2.5
# Share of a cell's variance that is not taken for bending, whatever its file rounded.
_LEFT = 0.25


def bending_variance(height: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the mean square, m², by which mean heights of cells miss those at grid points.

    The bending at the point, and by how much it differs around it, each by the share that the mean
    over a cell has in it. 0 where noise would make as much of both, or they are not known.

    Parameters
    ----------
    height, variance : (R, C) ndarrays
        Of the cells, metres and m²; NaN where empty.
    """
    square = np.nan_to_num(bending(height)) ** 2 + bending_range(height) ** 2
    noise = (BENDING_NOISE + BENDING_RANGE_NOISE) * _around(variance)
    return np.where(square > _CHANCE * noise, CELL_SHARE**2 * square, 0.0)


def at_grid_points(mapola: Mapola) -> Mapola:
    """Return `mapola` with heights that hold at the grid points, as far as its bending tells.

    The bending is taken for what it is likely to be beside its noise, as the bending around tells:
    on even ground nothing changes. What was uncertain by the bending there is so no longer; what
    is by its change from cell to cell remains.
    """
    miss = CELL_SHARE * _likely_bending(mapola)
    variance = np.maximum(mapola.sigma**2 - miss**2, _LEFT * mapola.sigma**2)
    return replace(mapola, height=mapola.height - miss, sigma=np.sqrt(variance))


def _likely_bending(mapola: Mapola) -> FloatArray:
    """Bending times the share of it, within the neighbourhood, that noise does not explain."""
    bend = bending(mapola.height)
    noise, square = BENDING_NOISE * _around(mapola.sigma**2), _around(bend**2)
    bent = square > noise
    share = 1.0 - np.divide(noise, square, out=np.ones(square.shape), where=bent)
    return np.nan_to_num(share * bend)


def _around(layer: FloatArray) -> FloatArray:
    """Mean of the known values in the neighbourhood of each cell (R, C); 0 if there are none."""
    known = np.isfinite(layer)
    # The filters' running sums leave rounding errors behind them: one cell is a 25th.
    share = uniform_filter(known.astype(np.float64), _AROUND)
    total = uniform_filter(np.where(known, layer, 0.0), _AROUND)
    some = share > 0.5 / _AROUND**2
    return np.where(some, np.maximum(total, 0.0) / np.where(some, share, 1.0), 0.0)
