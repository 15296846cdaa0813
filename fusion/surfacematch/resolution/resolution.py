"""Bringing two surfaces to one resolution.

Smoothing only one of two matched surfaces biases the scale by tens to hundreds of parts per
million. SPC smooths, a lidar does not (or less), so the blur of one against the other is estimated
and given to the sharper one before they are compared.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np
from scipy import ndimage
from scipy.optimize import minimize_scalar

from spcola.arrays import BoolArray, FloatArray
from spcola.grids import carried_on, closed
from spcola.math.robust import mad

# A smoothed value that rests on less than this share of the grid points around is not known.
_MIN_SUPPORT = 0.5
# Robust standard deviations beyond which a difference is none of noise.
_OUTLYING = 3.0


def plane_of(height: FloatArray) -> FloatArray:
    """Least-squares plane (R, C) through the known points of `height` (R, C), metres.

    0 if fewer than three points are known.
    """
    return _fitted(height, 3) if np.isfinite(height).sum() >= 3 else np.zeros(height.shape)


def trend_of(height: FloatArray) -> FloatArray:
    """Least-squares paraboloid (R, C) through the known points of `height` (R, C), metres.

    That of :func:`plane_of` if fewer than twelve points are known.
    """
    return _fitted(height, 6) if np.isfinite(height).sum() >= 12 else plane_of(height)


def _fitted(height: FloatArray, terms: int) -> FloatArray:
    """Least-squares polynomial (R, C) of the first `terms` of 1, x, y, x², xy, y²."""
    rows, columns = height.shape
    design = _polynomial((rows, columns))[:terms]
    known = np.isfinite(height)
    held = design * known.ravel()
    right = held @ np.where(known, height, 0.0).ravel()
    solution = np.linalg.lstsq(held @ design.T, right, rcond=1e-12)[0]
    fitted: FloatArray = (solution @ design).reshape(height.shape)
    return fitted


@lru_cache(4)
def _polynomial(shape: tuple[int, int]) -> FloatArray:
    """1, x, y, x², xy, y² (6, R·C) with x and y from −1 to 1 over a grid."""
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    design = np.stack([np.ones(shape), x, y, x * x, x * y, y * y]).reshape(6, -1)
    design.flags.writeable = False
    return design


def filled(height: FloatArray) -> FloatArray:
    """Return `height` (R, C), metres, with gaps closed by the nearest known point about its trend.

    Only so that splines can be run over it; what was a gap stays out of every comparison.
    """
    known = np.isfinite(height)
    if known.all() or not known.any():
        return np.where(known, height, 0.0)
    trend = trend_of(height)
    result: FloatArray = np.where(known, height, carried_on(height - trend) + trend)
    return result


def blur(height: FloatArray, sigma_cells: float, *, of_slopes: bool = True) -> FloatArray:
    """Gaussian smoothing of a surface's slopes, which leaves unknown points alone.

    SPC smooths slopes and integrates them; where its heights lie is told by stereo. The slopes of a
    paraboloid are planes, which no smoothing changes, so that the roundness of the body loses
    nothing. Smoothed as heights it does, by σ² over its radius, as the facets of a shape do.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN where unknown.
    sigma_cells : float
        Standard deviation of the Gaussian, cells.
    of_slopes : bool
        False: of the heights.

    Returns
    -------
    (R, C) ndarray
        NaN where `height` is, and where too little was known around.
    """
    known = np.isfinite(height)
    trend = trend_of(height) if of_slopes else plane_of(height)
    rest = np.where(known, height - trend, 0.0)
    rows, columns = height.shape
    whole = _support((rows, columns), sigma_cells)
    support = whole if known.all() else _smooth(known.astype(np.float64), sigma_cells)
    with np.errstate(invalid="ignore", divide="ignore"):
        soft = _smooth(rest, sigma_cells) / support
    enough = support > _MIN_SUPPORT * whole
    result: FloatArray = np.where(known & enough, soft + trend, np.nan)
    return result


@lru_cache(16)
def _support(shape: tuple[int, int], sigma_cells: float) -> FloatArray:
    """What smoothing leaves of ones on a grid without gaps."""
    support = _smooth(np.ones(shape), sigma_cells)
    support.flags.writeable = False
    return support


def blurred_over_gaps(
    height: FloatArray, sigma_cells: float, *, of_slopes: bool = True
) -> FloatArray:
    """As :func:`blur`, narrow gaps closed before: NaN again where `height` is.

    A mean over what is known alone lies aside of its point, and moves slopes with it.
    """
    soft = blur(closed(height), sigma_cells, of_slopes=of_slopes)
    return np.where(np.isfinite(height), soft, np.nan)


def _smooth(values: FloatArray, sigma_cells: float) -> FloatArray:
    return ndimage.gaussian_filter(values, sigma_cells, mode="constant", truncate=4.0)


def estimate_blur(
    lidar: FloatArray, spc: FloatArray, *, largest_cells: float = 4.0, of_slopes: bool = True
) -> float:
    """Blur of `spc` against `lidar` (same grid, aligned), as a Gaussian's sigma in cells.

    The blur is the one with which the smoothed lidar surface differs least from the SPC
    surface, in the robust sense, the same points being compared at every blur. Negative if it is
    the lidar that has to be compared with a smoothed SPC surface: where SPC has more than the
    lidar's detail. Which of them differ less in the end does not tell that, because smoothing takes
    the noise off SPC, the noisier of both, whichever is the softer.

    Parameters
    ----------
    lidar, spc : (R, C) ndarrays
        Heights, metres; NaN where unknown.
    largest_cells : float
        Largest blur that is tried, cells.
    of_slopes : bool
        As of :func:`blur`.

    Returns
    -------
    float
        In (−largest, largest); NaN if fewer than 100 points are common.
    """
    margin = np.isfinite(lidar) & np.isfinite(spc)
    lidar, spc = closed(lidar), closed(spc)
    margin &= np.isfinite(blur(lidar, largest_cells)) & np.isfinite(blur(spc, largest_cells))
    if margin.sum() < 100:
        return float("nan")
    soften = partial(blur, of_slopes=of_slopes)
    if _detail_kept(lidar, spc, margin, largest_cells) < 1.0:
        return _least(lidar, spc, margin, largest_cells, soften)
    return -_least(spc, lidar, margin, largest_cells, soften)


def _detail_kept(lidar: FloatArray, spc: FloatArray, common: BoolArray, largest: float) -> float:
    """Slope of the SPC surface's detail over that of the lidar: below 1 where SPC is softer.

    Noise of SPC does not bias it. Places where they differ by more than chance (strays, boulders)
    have no say.
    """
    sharp, soft = ((layer - blur(layer, largest))[common] for layer in (lidar, spc))
    rest = soft - sharp
    kept = np.abs(rest - np.median(rest)) <= _OUTLYING * mad(rest)
    return float(sharp[kept] @ soft[kept] / max(float(sharp[kept] @ sharp[kept]), 1e-300))


def _least(
    sharp: FloatArray,
    soft: FloatArray,
    common: BoolArray,
    largest: float,
    soften: Callable[[FloatArray, float], FloatArray],
) -> float:
    """The blur of `sharp` with which it differs least from `soft`."""

    def difference(sigma: float) -> float:
        rest = (soften(sharp, sigma) if sigma > 0.05 else sharp) - soft
        return float(mad(rest[common]))

    found = minimize_scalar(
        difference, bounds=(0.0, largest), method="bounded", options={"xatol": 0.02}
    )
    none = difference(0.0)
    return 0.0 if none <= found.fun else float(found.x)
