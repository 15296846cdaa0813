"""Uncertainty of a cell's height: the part that is not shared with other cells."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

from lidar.gridding.cells.cells import CellReturns
from lidar.gridding.cells.planes import PlaneFit
from lidar.gridding.point_heights import bending_variance
from spcola.arrays import AnyArray, FloatArray

# 1.4826 MAD of n Gaussian values is too small by these factors on average (Croux & Rousseeuw
# 1992); n/(n − 0.8) beyond the table.
_MAD_SMALL_SAMPLE = np.array(
    [np.nan, np.nan, 1.196, 1.495, 1.363, 1.206, 1.200, 1.140, 1.129, 1.107]
)
# Efficiency of the median absolute deviation: n − 1 values determine the spread as well as so many
# degrees of freedom each.
_MAD_EFFICIENCY = 0.37
# Half-width, in cells, of the neighbourhood whose spreads are pooled.
_POOL = 2
# A plane through 3 × 3 heights has six degrees of freedom: its misfit exceeds the noise by more
# than this, 1 + 2 √(2/6), where the ground is no plane.
_BENT = 2.15
# Degrees of freedom given to the wider spread (neighbourhood, grid) when it is averaged with the
# narrower one (cell, neighbourhood). A grid with fewer in all has no usable spread.
_PRIOR_FREEDOM = 10.0


def median_sigma(count: AnyArray) -> FloatArray:
    """Return the standard deviation of the median of `count` standard Gaussian values.

    Exact for 1 and 2 values, √(π / 2n) for many, and within 1.5 % between.
    """
    n = np.asarray(count, dtype=np.float64)
    extra = np.where(n % 2 == 1, np.pi / 2 - 1, np.pi - 2)
    with np.errstate(divide="ignore"):
        sigma: FloatArray = np.sqrt(np.pi / 2 / (n + extra))
    return np.where(n > 0, sigma, np.nan)


def height_sigma(
    cells: CellReturns,
    single: FloatArray,
    spread: FloatArray,
    planes: PlaneFit,
    height: FloatArray,
    *,
    default: float,
) -> FloatArray:
    """Return the standard deviation of each cell's median, metres, of the grid's shape.

    The larger of the returns' own sigma (`single`, by original return, NaN if unknown) and the
    cell's spread, averaged with that of the cells around where it is of few returns, times the
    factor of a median (:func:`median_sigma`); the share of the slopes' uncertainty; and the
    bending of the ground inside the cell (:mod:`lidar.gridding.point_heights`). The spread
    includes the roughness of the ground inside the cell, which is an error of the height too.

    Parameters
    ----------
    spread : ndarray
        Robust standard deviation in each cell, metres; NaN with fewer than three returns.
    height : ndarray
        Gridded heights, metres; NaN where empty.
    default : float
        Used where neither is known, metres.
    """
    own = _known_medians(cells, single)
    pooled, margin = _pooled_spread(cells.count, spread)
    # The larger of two estimates is too large on average when both estimate the same: the
    # spread is used only where it exceeds the sigma by more than chance.
    one = np.where(
        pooled > own * (1.0 + 2.0 * margin), pooled, np.where(np.isnan(own), pooled, own)
    )
    one = np.where(np.isnan(one), default, one)
    filled = cells.count > 0
    typical_slope = _typical_slope(planes, filled)
    variance = (one * median_sigma(cells.count)) ** 2 * (1.0 + 2.0 * planes.own)
    # A single return has weight ½ in the plane fit. At the edge of a boulder the cells are no
    # plane, and its slope is worse than their noise implies.
    bent = np.where(planes.misfit > _BENT * 0.5 * one**2, planes.misfit, 0.5 * one**2)
    variance = variance + bent * planes.leverage
    variance = variance + typical_slope**2 * planes.unresolved
    variance = variance + bending_variance(height, variance)
    return np.where(filled, np.sqrt(variance), np.nan)


def _known_medians(cells: CellReturns, single: FloatArray) -> FloatArray:
    """Median single-return sigma of each cell, of the returns whose sigma is known."""
    if len(single) and ((single == single[0]).all() or np.isnan(single).all()):
        return np.where(cells.count > 0, single[0], np.nan)
    sigma = single[cells.index]
    known = np.isfinite(sigma)
    return cells.select(known).medians(sigma[known])


def _pooled_spread(count: AnyArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Spread of each cell, metres, and its relative standard error.

    It is corrected for its small-sample bias and averaged with the spread of its surroundings; NaN
    if the whole grid has too few degrees of freedom.
    """
    small = _MAD_SMALL_SAMPLE[np.minimum(count, len(_MAD_SMALL_SAMPLE) - 1)]
    factor = np.where(count < len(_MAD_SMALL_SAMPLE), small, count / np.maximum(count - 0.8, 1.0))
    known = np.isfinite(spread)
    freedom = np.where(known, _MAD_EFFICIENCY * (count - 1.0), 0.0)
    unbiased = np.where(known, factor * spread, 0.0)
    if freedom.sum() < _PRIOR_FREEDOM:
        return np.full(spread.shape, np.nan), np.full(spread.shape, np.nan)
    # Averages of spreads, not of their squares: one rough cell must not dominate its surroundings.
    everywhere = float((freedom * unbiased).sum() / freedom.sum())
    width = 2 * _POOL + 1
    total = uniform_filter(freedom, width, mode="constant") * width**2
    weighted = uniform_filter(freedom * unbiased, width, mode="constant") * width**2
    around = (_PRIOR_FREEDOM * everywhere + weighted) / (_PRIOR_FREEDOM + total)
    pooled = _PRIOR_FREEDOM * around**2 + freedom * unbiased**2
    return (
        np.sqrt(pooled / (_PRIOR_FREEDOM + freedom)),
        np.sqrt(0.5 / (_PRIOR_FREEDOM + freedom)),
    )


def _typical_slope(planes: PlaneFit, filled: AnyArray) -> float:
    """Root mean square slope along one axis, metres per step: the size of an unresolved slope."""
    if not filled.any():
        return 0.0
    square = planes.slope_x[filled] ** 2 + planes.slope_y[filled] ** 2
    return float(np.sqrt(np.mean(square) / 2.0))
