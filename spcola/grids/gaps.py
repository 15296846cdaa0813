"""Gaps of a grid: detection of narrow ones, and interpolation from the known points around.

A filled value is never data: it only allows splines and filters to be applied to a layer.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, gaussian_filter

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled

__all__ = [
    "bridged",
    "bridged_mask",
    "carried_on",
    "closable",
    "closed",
    "filled",
    "plane_of",
    "trend_of",
]

# Gaussian, cells: in narrow gaps the smoothed share of known points exceeds this limit.
_NEAR, _SHARE = 1.0, 0.2
# Sweeps until narrow gaps bend least; in wide gaps more sweeps would hardly change the rim.
_SWEEPS = 30


def carried_on(layer: FloatArray) -> FloatArray:
    """Return a layer (R, C) with each unknown point at the value of the nearest known one.

    NaN everywhere if no point is known.
    """
    unknown = np.isnan(layer)
    if not unknown.any() or unknown.all():
        return layer
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return layer[tuple(nearest)]


def bridged_mask(known: BoolArray, max_gap: int) -> BoolArray:
    """Return `known` (R, C) with the gaps that are no wider than `max_gap` cells closed.

    A gap is closed if a square of max_gap + 1 cells does not fit into it (a morphological
    closing): the outline of the known area does not move outward.
    """
    width = max_gap + 1
    square = np.ones((width, width), dtype=bool)
    padded = np.pad(known, width)
    whole: BoolArray = binary_erosion(binary_dilation(padded, square), square)
    return whole[width:-width, width:-width] | known


def closable(known: BoolArray) -> BoolArray:
    """Mask (R, C) of points that are known or lie in a gap narrow enough to be closed."""
    if known.all():
        return known
    return known | (gaussian_filter(known.astype(np.float64), _NEAR) > _SHARE)


def closed(layer: FloatArray) -> FloatArray:
    """Return a layer (R, C) with its narrow gaps closed by least bending; the others NaN.

    Heights that are missing at random, or line by line, are nearly as good as known ones: a
    surface smooth over some cells is determined by the cells around. Their mean would flatten it.
    Of a gap wider than two cells only the rim is closed.
    """
    known = np.isfinite(layer)
    if known.all() or not known.any():
        return layer
    near = closable(known)
    whole = carried_on(layer)
    _relax(whole, np.argwhere(near & ~known), _SWEEPS)
    return np.where(near, whole, np.nan)


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
    weighted = design * known.ravel()
    right = weighted @ np.where(known, height, 0.0).ravel()
    solution = np.linalg.lstsq(weighted @ design.T, right, rcond=1e-12)[0]
    return (solution @ design).reshape(height.shape)


@lru_cache(4)
def _polynomial(shape: tuple[int, int]) -> FloatArray:
    """1, x, y, x², xy, y² (6, R·C) with x and y from −1 to 1 over a grid."""
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    design = np.stack([np.ones(shape), x, y, x * x, x * y, y * y]).reshape(6, -1)
    design.flags.writeable = False
    return design


def filled(height: FloatArray) -> FloatArray:
    """Return `height` (R, C), metres, with gaps closed by the nearest known point about its trend.

    Only for interpolation by splines; points of gaps are excluded from every comparison.
    """
    known = np.isfinite(height)
    if known.all() or not known.any():
        return np.where(known, height, 0.0)
    trend = trend_of(height)
    return np.where(known, height, carried_on(height - trend) + trend)


def bridged(height: FloatArray) -> FloatArray:
    """Return `height` (R, C), metres, with gaps interpolated: smoothly where they are narrow.

    A wide gap, or one that is open to the edge, is filled with the surface's paraboloid: a level
    filling would have a kink that a filter carries far. 0 everywhere if nothing is known.
    """
    known = np.isfinite(height)
    if known.all():
        return height
    if not known.any():
        return np.zeros(height.shape)
    trend = trend_of(height)
    return carried_on(closed(height - trend)) + trend


@compiled
def _relax(layer: FloatArray, points: IntArray, sweeps: int) -> None:
    """Move some points (N, 2), row and column, of a layer to least bending, in place.

    Gauss–Seidel on the squared Laplacian, with the layer extended beyond its edges.
    """
    last_row, last_column = layer.shape[0] - 1, layer.shape[1] - 1
    for _ in range(sweeps):
        for n in range(points.shape[0]):
            r, c = points[n]
            up, down = max(r - 1, 0), min(r + 1, last_row)
            left, right = max(c - 1, 0), min(c + 1, last_column)
            sides = layer[up, c] + layer[down, c] + layer[r, left] + layer[r, right]
            corners = layer[up, left] + layer[up, right] + layer[down, left] + layer[down, right]
            far = layer[max(r - 2, 0), c] + layer[min(r + 2, last_row), c]
            far += layer[r, max(c - 2, 0)] + layer[r, min(c + 2, last_column)]
            layer[r, c] = (8.0 * sides - 2.0 * corners - far) / 20.0
