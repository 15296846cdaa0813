"""Cubic splines through gridded heights, without bias at the edges of a round body."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.compilation import compiled

BORDER = 2
"""Coefficients of a spline beyond each edge of its grid."""
# Cells over which an edge affects spline coefficients.
_EDGE_REACH = 14


def spline_coefficients(height: FloatArray) -> FloatArray:
    """Return coefficients (R + 4, C + 4) of the cubic spline through `height` (R, C) without gaps.

    Beyond its edges a surface is continued by point reflection in the edge. Mirror reflection would
    make it level there, whereas a round body is steepest at the edges of its maplets: this would
    bias a displacement by up to a tenth of a cell.
    """
    wide = np.pad(height, _EDGE_REACH, mode="reflect", reflect_type="odd")
    cut = _EDGE_REACH - BORDER
    return np.ascontiguousarray(ndimage.spline_filter(wide, order=3)[cut:-cut, cut:-cut])


@compiled
def spline_at(coefficients: FloatArray, x: float, y: float) -> float:
    """Return the height at column `x` and row `y` of a grid, by its spline's `coefficients`."""
    last = coefficients.shape[0] - 1
    column, row = int(np.floor(x)), int(np.floor(y))
    t, u = x - column, y - row
    total = 0.0
    for i in range(4):
        wy = _basis(i, u)
        r = min(max(row - 1 + i + BORDER, 0), last)
        for j in range(4):
            c = min(max(column - 1 + j + BORDER, 0), last)
            total += wy * _basis(j, t) * coefficients[r, c]
    return total


@compiled
def _basis(number: int, t: float) -> float:
    """Values of the four cubic B-splines that are not 0 between two knots, at share `t`."""
    if number == 0:
        return (1.0 - t) ** 3 / 6.0
    if number == 1:
        return (3.0 * t**3 - 6.0 * t**2 + 4.0) / 6.0
    if number == 2:
        return (-3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0) / 6.0
    return t**3 / 6.0
