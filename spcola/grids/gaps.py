"""Unknown points of a grid: what the known ones around say of them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled

# Gaussian, cells, of the neighbourhood of which a point of a narrow gap knows this share.
_NEAR, _SHARE = 1.0, 0.2
# Sweeps after which narrow gaps bend least; in wide ones more would change little that is near.
_SWEEPS = 30


def carried_on(layer: FloatArray) -> FloatArray:
    """Return a layer (R, C) in which each unknown point has the value of the nearest known one.

    NaN everywhere if no point is known.
    """
    unknown = np.isnan(layer)
    if not unknown.any() or unknown.all():
        return layer
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    whole: FloatArray = layer[tuple(nearest)]
    return whole


def closable(known: BoolArray) -> BoolArray:
    """Mask (R, C) of what is known or lies in a gap narrow enough to be closed from around."""
    if known.all():
        return known
    near: BoolArray = known | (gaussian_filter(known.astype(np.float64), _NEAR) > _SHARE)
    return near


def closed(layer: FloatArray) -> FloatArray:
    """Return a layer (R, C) with its narrow gaps closed so that it bends least; the others NaN.

    Heights that are missing at random, or line by line, are nearly as good as if they were known:
    what is smooth over some cells is told by the cells around. A mean of these would flatten it.
    Of a gap wider than two cells only the rim is closed.
    """
    known = np.isfinite(layer)
    if known.all() or not known.any():
        return layer
    near = closable(known)
    whole = carried_on(layer)
    _relax(whole, np.argwhere(near & ~known), _SWEEPS)
    return np.where(near, whole, np.nan)


@compiled
def _relax(layer: FloatArray, points: IntArray, sweeps: int) -> None:
    """Move some points (N, 2), row and column, of a layer to where it bends least, in place.

    Gauss–Seidel on the squared Laplacian, the layer carried on beyond its edges.
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
