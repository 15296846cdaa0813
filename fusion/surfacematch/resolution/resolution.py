"""Bringing two surfaces to one resolution.

Smoothing only one of two matched surfaces biases the scale by tens to hundreds of parts per
million. SPC smooths, a lidar does not (or less), so the blur of one relative to the other is
estimated and applied to the sharper one before they are compared.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize_scalar

from spcola.arrays import BoolArray, FloatArray
from spcola.grids.gaps import closed, plane_of, trend_of
from spcola.math.robust import mad

# A smoothed value needs at least this share of the (weighted) grid points around it.
_MIN_SUPPORT = 0.5
# Robust standard deviations beyond which a difference is not noise.
_OUTLYING = 3.0
# Largest blur of the search, cells.
_LARGEST_CELLS = 4.0


def blur(height: FloatArray, sigma_cells: float, *, of_slopes: bool = True) -> FloatArray:
    """Gaussian smoothing of a surface's slopes; unknown points are left out.

    SPC smooths slopes and integrates them, and its absolute heights are determined by stereo. The
    slopes of a paraboloid are planes, which smoothing does not change, so the curvature of the body
    causes no bias. Smoothing of heights, as by the facets of a shape, lowers them by σ² over the
    body's radius.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.
    sigma_cells : float
        Standard deviation of the Gaussian, cells.
    of_slopes : bool
        False: smooth the heights.

    Returns
    -------
    (R, C) ndarray
        NaN where `height` is, and where too few points around are known.
    """
    known = np.isfinite(height)
    trend = trend_of(height) if of_slopes else plane_of(height)
    rest = np.where(known, height - trend, 0.0)
    rows, columns = height.shape
    whole = _support((rows, columns), sigma_cells)
    support = whole if known.all() else _smooth(known.astype(np.float64), sigma_cells)
    with np.errstate(invalid="ignore", divide="ignore"):
        smooth = _smooth(rest, sigma_cells) / support
    enough = support > _MIN_SUPPORT * whole
    result: FloatArray = np.where(known & enough, smooth + trend, np.nan)
    return result


@lru_cache(16)
def _support(shape: tuple[int, int], sigma_cells: float) -> FloatArray:
    """A layer of ones, smoothed: less than 1 near the edges of the grid."""
    support = _smooth(np.ones(shape), sigma_cells)
    support.flags.writeable = False
    return support


def blurred_over_gaps(
    height: FloatArray, sigma_cells: float, *, of_slopes: bool = True
) -> FloatArray:
    """Return :func:`blur` of the surface with narrow gaps filled; NaN where `height` is.

    A mean over only the known points would belong to a place next to the point, and bias slopes.
    """
    smooth = blur(closed(height), sigma_cells, of_slopes=of_slopes)
    return np.where(np.isfinite(height), smooth, np.nan)


def _smooth(values: FloatArray, sigma_cells: float) -> FloatArray:
    return ndimage.gaussian_filter(values, sigma_cells, mode="constant", truncate=4.0)


def estimate_blur(lidar: FloatArray, spc: FloatArray, *, of_slopes: bool = True) -> float:
    """Blur of `spc` relative to `lidar` (same grid, aligned), as a Gaussian's sigma in cells.

    The blur minimises the robust standard deviation of smoothed lidar minus SPC heights, over the
    same points at every blur. It is negative if SPC has more detail than the lidar, so that SPC has
    to be smoothed. The sign follows from the slope of one surface's detail over the other's, not
    from the remaining difference: smoothing always reduces the noise of SPC, the noisier of both.

    Parameters
    ----------
    lidar, spc : (R, C) ndarrays
        Heights, metres; NaN where unknown.
    of_slopes : bool
        As of :func:`blur`.

    Returns
    -------
    float
        In (−largest, largest); NaN if fewer than 100 points are common.
    """
    margin = np.isfinite(lidar) & np.isfinite(spc)
    lidar, spc = closed(lidar), closed(spc)
    margin &= np.isfinite(blur(lidar, _LARGEST_CELLS)) & np.isfinite(blur(spc, _LARGEST_CELLS))
    if margin.sum() < 100:
        return float("nan")
    smooth = partial(blur, of_slopes=of_slopes)
    if _detail_ratio(lidar, spc, margin, _LARGEST_CELLS) < 1.0:
        return _least(lidar, spc, margin, _LARGEST_CELLS, smooth)
    return -_least(spc, lidar, margin, _LARGEST_CELLS, smooth)


def _detail_ratio(lidar: FloatArray, spc: FloatArray, common: BoolArray, largest: float) -> float:
    """Regression slope of the SPC surface's detail on the lidar's: below 1 if SPC is blurred.

    Noise of SPC does not bias it. Outliers (isolated points, boulders) are excluded.
    """
    sharp, blurred = ((layer - blur(layer, largest))[common] for layer in (lidar, spc))
    rest = blurred - sharp
    kept = np.abs(rest - np.median(rest)) <= _OUTLYING * mad(rest)
    return float(sharp[kept] @ blurred[kept] / max(float(sharp[kept] @ sharp[kept]), 1e-300))


def _least(
    sharp: FloatArray,
    blurred: FloatArray,
    common: BoolArray,
    largest: float,
    smooth: Callable[[FloatArray, float], FloatArray],
) -> float:
    """The blur of `sharp` with which it differs least from `blurred`."""

    def difference(sigma: float) -> float:
        rest = (smooth(sharp, sigma) if sigma > 0.05 else sharp) - blurred
        return float(mad(rest[common]))

    found = minimize_scalar(
        difference, bounds=(0.0, largest), method="bounded", options={"xatol": 0.02}
    )
    none = difference(0.0)
    return 0.0 if none <= found.fun else float(found.x)
