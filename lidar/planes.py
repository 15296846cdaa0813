"""Planes through the heights of neighbouring cells: the slopes of gridded returns.

The heights stand at the cells' own *places* (the mean position of their returns), not at the
grid points. A plane through such heights has the slope of the ground whatever the returns'
positions in their cells, so that slopes need no good start, bear gaps, and the iteration of
:mod:`lidar.gridding` cannot feed on its own errors: with one return in each cell it is exact
after a single round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel

Moments = tuple[float, float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """Slopes of planes fitted around each cell; layers of the grid's shape.

    Attributes
    ----------
    slope_x, slope_y : ndarrays
        Along Ux and Uy, metres per grid step; 0 where nothing determines them.
    leverage : ndarray
        Variance that the slopes' uncertainty adds to a height carried from the cell's place to
        its grid point, in units of the variance of one weight-1 height.
    own : ndarray
        Share of the cell's own height in that correction: its error is in the slopes as well,
        and partly takes itself back.
    unresolved : ndarray
        Square of that carrying distance along directions in which the slope is not
        determined, square grid steps.
    misfit : ndarray
        Variance of one weight-1 height about the plane, m²: noise, and ground that is no plane.
        0 where no more than three heights determine it.
    """

    slope_x: FloatArray
    slope_y: FloatArray
    leverage: FloatArray
    own: FloatArray
    unresolved: FloatArray
    misfit: FloatArray


def fit_planes(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    *,
    baseline: float,
    max_radius: int,
) -> PlaneFit:
    """Fit a plane to the 3 × 3 cells around each cell that has a height.

    Where those leave a direction in which the places scatter by less than `baseline` (grid
    steps, standard deviation), 5 × 5 cells are taken, and so on up to `max_radius`; a direction
    that is still not determined is given the slope 0.

    Parameters
    ----------
    place_x, place_y : (R, C) ndarrays
        Place of each cell's height less that of its grid point, grid steps.
    height : (R, C) ndarray
        Metres at that place; NaN where empty.
    weight : (R, C) ndarray
        Relative weights of the heights.
    """
    layers = _fit_planes(place_x, place_y, height, weight, baseline**2, max_radius)
    return PlaneFit(layers[0], layers[1], layers[2], layers[3], layers[4], layers[5])


class PlaneWindows:
    """The windows of :func:`fit_planes`, for heights that change at places that do not.

    Slopes are linear in the heights. In windows of 3 × 3 cells, which nearly all are, the factors
    are kept.

    Parameters
    ----------
    place_x, place_y : (R, C) ndarrays
        As for :func:`fit_planes`; NaN where empty.
    weight : (R, C) ndarray
        Relative weights of the heights; 0 where empty.
    baseline, max_radius
        As for :func:`fit_planes`.
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
        framed = [_framed(layer) for layer in self._cells]
        self._wide = _factors(framed[0], framed[1], framed[2], self._least, self._factor)

    def fit(self, height: FloatArray) -> PlaneFit:
        """Return all that is known of the planes through `height` (R, C), as for `slopes`."""
        layers = _fit_planes(
            *self._cells[:2], height, self._cells[2], self._least, self._max_radius
        )
        return PlaneFit(layers[0], layers[1], layers[2], layers[3], layers[4], layers[5])

    def slopes(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the slopes along Ux and Uy (R, C), metres per step, 0 where empty.

        `height` (R, C) are metres at the places; NaN where these are.
        """
        slopes = np.zeros((2, *height.shape))
        _apply(_framed(height), self._factor, slopes)
        place_x, place_y, weight = self._cells
        windows = (self._least, self._max_radius)
        _slopes_of_wide(self._wide, place_x, place_y, height, weight, windows, slopes)
        return slopes[0], slopes[1]


def _framed(layer: FloatArray) -> FloatArray:
    """Return a layer with a frame of one cell, 0 there and where it is empty."""
    framed = np.zeros((layer.shape[0] + 2, layer.shape[1] + 2))
    framed[1:-1, 1:-1] = np.nan_to_num(layer)
    return framed


@kernel
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


@kernel
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


@kernel
def _is_narrow(sums: FloatArray, weight: float, least: float) -> bool:
    """Make of the sums of a window its mean and what the factors need; 0 where it is too narrow.

    These are 1 / (Σw determinant), mean x and y, and the moments xx, xy and yy about the mean.
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


@kernel
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


@kernel
def _apply(height: FloatArray, factor: FloatArray, slopes: FloatArray) -> None:
    """Sum the factors times the heights (framed) less that of the middle of the window."""
    for row in range(slopes.shape[1]):
        middle = height[row + 1, 1:]
        for k in range(9):
            there = height[row + k // 3, k % 3 :]
            for axis in range(2):
                _add_product(factor[row, axis, k], there, middle, slopes[axis, row])


@kernel
def _add_product(
    factor: FloatArray, there: FloatArray, middle: FloatArray, out: FloatArray
) -> None:
    for j in range(len(out)):
        out[j] += factor[j] * (there[j] - middle[j])


@kernel
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
        layers = _fitted(place_x, place_y, height, weight, row, column, least, max_radius)
        slopes[0, row, column], slopes[1, row, column] = layers[0], layers[1]


@kernel
def _fit_planes(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    least: float,
    max_radius: int,
) -> FloatArray:
    rows, columns = height.shape
    layers = np.zeros((6, rows, columns))
    for row in range(rows):
        for column in range(columns):
            if np.isnan(height[row, column]):
                continue
            layers[:, row, column] = _fitted(
                place_x, place_y, height, weight, row, column, least, max_radius
            )
    return layers


@kernel
def _fitted(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    row: int,
    column: int,
    least: float,
    max_radius: int,
) -> FloatArray:
    """What is known of the plane of one cell, in the order of `PlaneFit`."""
    radius, fitted = 1, False
    while not fitted and radius <= max_radius:
        moments = _moments(place_x, place_y, height, weight, row, column, radius)
        fitted = _smaller_variance(moments) >= least
        radius += 1
    return _slope(moments, least, place_x[row, column], place_y[row, column], weight[row, column])


@kernel
def _moments(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    row: int,
    column: int,
    radius: int,
) -> Moments:
    """Σw, mean x and y, moments xx, xy, yy, xh, yh, hh about the mean over Σw, and the count."""
    rows, columns = height.shape
    total = sum_x = sum_y = sum_h = count = 0.0
    xx = xy = yy = xh = yh = hh = 0.0
    # Heights from that of the middle: the body's radius would eat the digits of the squares.
    middle = height[row, column]
    for r in range(max(0, row - radius), min(rows, row + radius + 1)):
        for c in range(max(0, column - radius), min(columns, column + radius + 1)):
            h = height[r, c] - middle
            if np.isnan(h):
                continue
            w = weight[r, c]
            x, y = c - column + place_x[r, c], r - row + place_y[r, c]
            wx, wy = w * x, w * y
            total += w
            sum_x += wx
            sum_y += wy
            sum_h += w * h
            xx += wx * x
            xy += wx * y
            yy += wy * y
            xh += wx * h
            yh += wy * h
            hh += w * h * h
            count += 1.0
    mean_x, mean_y, mean_h = sum_x / total, sum_y / total, sum_h / total
    xx, xy, yy = xx / total - mean_x**2, xy / total - mean_x * mean_y, yy / total - mean_y**2
    xh, yh = xh / total - mean_x * mean_h, yh / total - mean_y * mean_h
    hh = max(hh / total - mean_h**2, 0.0)
    return total, mean_x, mean_y, xx, xy, yy, xh, yh, hh, count


@kernel
def _smaller_variance(moments: Moments) -> float:
    """Variance of the places along the direction in which they scatter least."""
    _, _, _, xx, xy, yy, _, _, _, _ = moments
    return 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)


@kernel
def _slope(
    moments: Moments,
    least: float,
    place_x: float,
    place_y: float,
    weight: float,
) -> FloatArray:
    """Slopes x and y, leverage, own share, unresolved distance² and misfit, by principal axes."""
    total, mean_x, mean_y, xx, xy, yy, xh, yh, hh, count = moments
    result = np.zeros(6)
    if _smaller_variance(moments) >= least:
        # Both directions are determined: Cramer's rule, without the angles.
        determinant = xx * yy - xy * xy
        slope_x = (yy * xh - xy * yh) / determinant
        slope_y = (xx * yh - xy * xh) / determinant
        carried_x = (yy * place_x - xy * place_y) / determinant
        carried_y = (xx * place_y - xy * place_x) / determinant
        lever = carried_x * (place_x - mean_x) + carried_y * (place_y - mean_y)
        result[0], result[1] = slope_x, slope_y
        result[2] = (carried_x * place_x + carried_y * place_y) / total
        result[3] = -weight * lever / total
        left = hh - slope_x * xh - slope_y * yh
    else:
        left = _by_principal_axes(moments, least, place_x, place_y, weight, result)
    if count > 3:
        result[5] = max(left, 0.0) * total / (count - 3)
    return result


@kernel
def _by_principal_axes(
    moments: Moments,
    least: float,
    place_x: float,
    place_y: float,
    weight: float,
    result: FloatArray,
) -> float:
    """Fill in what the determined direction tells, if one is; return what of hh is left."""
    total, mean_x, mean_y, xx, xy, yy, xh, yh, hh, _ = moments
    half, mean = np.hypot(0.5 * (xx - yy), xy), 0.5 * (xx + yy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    left = hh
    for axis in range(2):
        along_x = np.cos(angle) if axis == 0 else -np.sin(angle)
        along_y = np.sin(angle) if axis == 0 else np.cos(angle)
        variance = mean + half if axis == 0 else mean - half
        carried = along_x * place_x + along_y * place_y
        if variance >= least:
            slope = (along_x * xh + along_y * yh) / variance
            left -= slope * slope * variance
            result[0] += slope * along_x
            result[1] += slope * along_y
            result[2] += carried * carried / (total * variance)
            lever = along_x * (place_x - mean_x) + along_y * (place_y - mean_y)
            result[3] -= carried * weight * lever / (total * variance)
        else:
            result[4] += carried * carried
    return left
