"""Plane fits in fixed windows of cells, for heights that change while their places do not.

The slopes of a plane are linear in the heights: sums with factors given by the places, along whole
rows of a grid. An iteration of slopes and medians uses them a dozen times.
"""

from __future__ import annotations

import numpy as np

from lidar.gridding.cells.planes import PlaneFit, fitted_plane, plane_layers
from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled


class PlaneWindows:
    """Windows of ``fit_planes`` with fixed places.

    Slopes are linear in the heights. In windows of 3 × 3 cells, which nearly all are, the factors
    are stored.

    Parameters
    ----------
    place_x, place_y : (R, C) ndarrays
        As for ``fit_planes``; NaN where empty.
    weight : (R, C) ndarray
        Relative weights of the heights; 0 where empty.
    baseline, max_radius
        As for ``fit_planes``.
    """

    def __init__(
        self,
        place_x: FloatArray,
        place_y: FloatArray,
        weight: FloatArray,
        *,
        baseline: float,
        max_radius: int,
    ) -> None:
        rows, columns = weight.shape
        self._cells = (place_x, place_y, weight)
        self._least, self._max_radius = baseline**2, max_radius
        self._factor = np.zeros((rows, 2, 9, columns))
        x, y, w = (_framed(layer) for layer in self._cells)
        self._wide = _factors(x, y, w, self._least, self._factor)

    def fit(self, height: FloatArray) -> PlaneFit:
        """Return the planes through `height` (R, C), as :func:`fit_planes` does."""
        place_x, place_y, weight = self._cells
        return PlaneFit(
            *plane_layers(place_x, place_y, height, weight, self._least, self._max_radius)
        )

    def slopes(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the slopes along Ux and Uy (R, C), metres per step, 0 where empty.

        `height` (R, C) are metres at the places; NaN where empty.
        """
        windows = (self._least, self._max_radius)
        slopes = _slopes(height, self._factor, self._wide, self._cells, windows)
        return slopes[0], slopes[1]


@compiled
def _framed(layer: FloatArray) -> FloatArray:
    """Return a layer with a frame of one cell, 0 there and where it is empty."""
    rows, columns = layer.shape
    framed = np.zeros((rows + 2, columns + 2))
    for row in range(rows):
        for column in range(columns):
            value = layer[row, column]
            framed[row + 1, column + 1] = 0.0 if np.isnan(value) else value
    return framed


@compiled
def _factors(
    place_x: FloatArray, place_y: FloatArray, weight: FloatArray, least: float, factor: FloatArray
) -> IntArray:
    """Fill the factors (R, 2, 9, C) of 3 × 3 heights in both slopes; 0 where the window is wider.

    Layers are framed. Returns the numbers (row-major) of the cells whose window is wider. The
    work goes along rows, so that the loops have no branches.
    """
    rows, columns = factor.shape[0], factor.shape[3]
    wide = np.empty(rows * columns, dtype=np.int64)
    count = 0
    sums = np.empty((6, columns))
    for row in range(rows):
        sums[:] = 0.0
        for k in range(9):
            down, right = k // 3 - 1, k % 3 - 1
            r, c = row + 1 + down, 1 + right
            x, y, w = place_x[r, c:], place_y[r, c:], weight[r, c:]
            _add_moments(x, y, w, float(right), float(down), sums)
        for j in range(columns):
            narrow = _is_narrow(sums[:, j], weight[row + 1, j + 1], least)
            if narrow and weight[row + 1, j + 1] > 0:
                wide[count] = row * columns + j
                count += 1
        for k in range(9):
            down, right = k // 3 - 1, k % 3 - 1
            r, c = row + 1 + down, 1 + right
            x, y, w = place_x[r, c:], place_y[r, c:], weight[r, c:]
            _set_factors(x, y, w, float(right), float(down), sums, factor[row, :, k])
    return wide[:count]


@compiled
def _add_moments(
    x: FloatArray, y: FloatArray, w: FloatArray, right: float, down: float, sums: FloatArray
) -> None:
    """Add one cell of each window to Σw, Σwx, Σwy, Σwxx, Σwxy, Σwyy."""
    for j in range(sums.shape[1]):
        along_x, along_y = right + x[j], down + y[j]
        wx, wy = w[j] * along_x, w[j] * along_y
        sums[0, j] += w[j]
        sums[1, j] += wx
        sums[2, j] += wy
        sums[3, j] += wx * along_x
        sums[4, j] += wx * along_y
        sums[5, j] += wy * along_y


@compiled
def _is_narrow(sums: FloatArray, weight: float, least: float) -> bool:
    """Turn the sums of a window into its mean and terms of the factors; 0 where it is too narrow.

    The terms are 1 / (Σw determinant), mean x and y, and the moments xx, xy and yy about the mean.
    """
    if not weight > 0:
        sums[0] = 0.0
        return True
    total = sums[0]
    x, y = sums[1] / total, sums[2] / total
    xx, xy, yy = sums[3] / total - x * x, sums[4] / total - x * y, sums[5] / total - y * y
    narrow = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy) < least
    sums[0] = 0.0 if narrow else 1.0 / (total * (xx * yy - xy * xy))
    sums[1], sums[2], sums[3], sums[4], sums[5] = x, y, xx, xy, yy
    return bool(narrow)


@compiled
def _set_factors(
    x: FloatArray,
    y: FloatArray,
    w: FloatArray,
    right: float,
    down: float,
    sums: FloatArray,
    factor: FloatArray,
) -> None:
    """Factors (2, C) of the heights of one cell of each window, by Cramer's rule."""
    for j in range(factor.shape[1]):
        along_x, along_y = right + x[j] - sums[1, j], down + y[j] - sums[2, j]
        share = w[j] * sums[0, j]
        factor[0, j] = share * (sums[5, j] * along_x - sums[4, j] * along_y)
        factor[1, j] = share * (sums[3, j] * along_y - sums[4, j] * along_x)


@compiled
def _slopes(
    height: FloatArray,
    factor: FloatArray,
    wide: IntArray,
    cells: tuple[FloatArray, FloatArray, FloatArray],
    windows: tuple[float, int],
) -> FloatArray:
    """Slopes (2, R, C) of all cells."""
    slopes = np.zeros((2, *height.shape))
    _apply(_framed(height), factor, slopes)
    _slopes_of_wide(wide, cells[0], cells[1], height, cells[2], windows, slopes)
    return slopes


@compiled
def _apply(height: FloatArray, factor: FloatArray, slopes: FloatArray) -> None:
    """Sum the factors times the heights (framed) less that of the middle of the window."""
    for row in range(slopes.shape[1]):
        middle = height[row + 1, 1:]
        for k in range(9):
            there = height[row + k // 3, k % 3 :]
            for axis in range(2):
                _add_product(factor[row, axis, k], there, middle, slopes[axis, row])


@compiled
def _add_product(
    factor: FloatArray, there: FloatArray, middle: FloatArray, out: FloatArray
) -> None:
    for j in range(len(out)):
        out[j] += factor[j] * (there[j] - middle[j])


@compiled
def _slopes_of_wide(
    chosen: IntArray,
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    windows: tuple[float, int],
    slopes: FloatArray,
) -> None:
    """Slopes of the cells (row-major numbers) whose windows are wider than 3 × 3."""
    least, max_radius = windows
    columns = height.shape[1]
    for number in chosen:
        row, column = number // columns, number % columns
        layers = fitted_plane(place_x, place_y, height, weight, row, column, least, max_radius)
        slopes[0, row, column], slopes[1, row, column] = layers[0], layers[1]
