"""Conversion of mean heights of cells to heights at grid points.

The slope-corrected median of a cell [36] is the height at its grid point where the ground is a
plane. Where it bends, the returns of the cell give its mean: the top of a boulder comes out too
low, its foot too high.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter

from lidar.gridding.mapola import Mapola
from spcola.arrays import FloatArray
from spcola.grids.bending import (
    BENDING_NOISE,
    BENDING_RANGE_NOISE,
    CELL_SHARE,
    bending,
    bending_range,
)

# Width, in cells, of the neighbourhood in which bending is estimated.
_AROUND = 5
# Noise exceeds so many times its mean square in only a few per cent of places.
_CHANCE = 2.5
# Share of a cell's variance that is never attributed to bending, whatever the file's rounding.
_LEFT = 0.25


def bending_variance(height: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the mean square difference, m², between mean heights of cells and heights at points.

    The bending at the point, and its variation around it, each by its effect on the mean over a
    cell. 0 where noise would cause as much of both, or they are unknown.

    Parameters
    ----------
    height, variance : (R, C) ndarrays
        Of the cells, metres and m²; NaN where empty.
    """
    square = np.nan_to_num(bending(height)) ** 2 + bending_range(height) ** 2
    noise = (BENDING_NOISE + BENDING_RANGE_NOISE) * _around(variance)
    return np.where(square > _CHANCE * noise, CELL_SHARE**2 * square, 0.0)


def at_grid_points(mapola: Mapola) -> Mapola:
    """Return `mapola` with heights at the grid points, corrected for bending.

    The correction is the part of the bending that noise does not explain, as estimated around
    each cell: even ground is unchanged. The uncertainty due to bending at the point is removed;
    that due to its change from cell to cell remains.
    """
    miss = CELL_SHARE * _likely_bending(mapola)
    variance = np.maximum(mapola.sigma**2 - miss**2, _LEFT * mapola.sigma**2)
    return replace(mapola, height=mapola.height - miss, sigma=np.sqrt(variance))


def _likely_bending(mapola: Mapola) -> FloatArray:
    """Bending, reduced by the share that noise explains in the neighbourhood."""
    bend = bending(mapola.height)
    noise, square = BENDING_NOISE * _around(mapola.sigma**2), _around(bend**2)
    bent = square > noise
    share = 1.0 - np.divide(noise, square, out=np.ones(square.shape), where=bent)
    return np.nan_to_num(share * bend)


def _around(layer: FloatArray) -> FloatArray:
    """Mean of the known values in the neighbourhood of each cell (R, C); 0 if there are none."""
    known = np.isfinite(layer)
    # The filters' running sums leave rounding errors: one cell is a 25th.
    share = uniform_filter(known.astype(np.float64), _AROUND)
    total = uniform_filter(np.where(known, layer, 0.0), _AROUND)
    some = share > 0.5 / _AROUND**2
    return np.where(some, np.maximum(total, 0.0) / np.where(some, share, 1.0), 0.0)
