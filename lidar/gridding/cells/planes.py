"""Planes through the heights of neighbouring cells: the slopes of gridded returns.

The heights belong to the cells' own *places* (the mean position of their returns), not to the grid
points. A plane through such heights has the slope of the ground whatever the returns' positions in
their cells, so that slopes need no good start, tolerate gaps, and the iteration of
:mod:`lidar.gridding.iteration` cannot amplify its own errors: with one return in each cell it is
exact after a single round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled

Moments = tuple[float, float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """Slopes of planes fitted around each cell; layers of the grid's shape.

    Attributes
    ----------
    slope_x, slope_y : ndarrays
        Along Ux and Uy, metres per grid step; 0 where nothing determines them.
    leverage : ndarray
        Variance that the slopes' uncertainty adds to a height moved from the cell's place to its
        grid point, in units of the variance of one weight-1 height.
    own : ndarray
        Weight of the cell's own height in that correction: its error is in the slopes as well,
        and partly cancels.
    unresolved : ndarray
        Square of the distance from place to grid point along directions in which the slope is
        not determined, square grid steps.
    misfit : ndarray
        Variance of one weight-1 height about the plane, m²: noise, and departures from a plane.
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

    Where those leave a direction in which the places scatter by less than `baseline` (grid steps,
    standard deviation), 5 × 5 cells are used, and so on up to `max_radius`; a direction that is
    still not determined gets the slope 0.

    Parameters
    ----------
    place_x, place_y : (R, C) ndarrays
        Place of each cell's height less that of its grid point, grid steps.
    height : (R, C) ndarray
        Metres at that place; NaN where empty.
    weight : (R, C) ndarray
        Relative weights of the heights.
    """
    return PlaneFit(*plane_layers(place_x, place_y, height, weight, baseline**2, max_radius))


@compiled
def plane_layers(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    least: float,
    max_radius: int,
) -> FloatArray:
    """Layers (6, R, C) of `PlaneFit`, in its order; `least` is the square of the baseline."""
    rows, columns = height.shape
    layers = np.zeros((6, rows, columns))
    for row in range(rows):
        for column in range(columns):
            if np.isnan(height[row, column]):
                continue
            layers[:, row, column] = fitted_plane(
                place_x, place_y, height, weight, row, column, least, max_radius
            )
    return layers


@compiled
def fitted_plane(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    row: int,
    column: int,
    least: float,
    max_radius: int,
) -> FloatArray:
    """Layers of the plane of one cell, in the order of `PlaneFit`."""
    radius, fitted = 1, False
    while not fitted and radius <= max_radius:
        moments = _moments(place_x, place_y, height, weight, row, column, radius)
        fitted = _smaller_variance(moments) >= least
        radius += 1
    return _slope(moments, least, place_x[row, column], place_y[row, column], weight[row, column])


@compiled
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
    # Heights relative to the middle one: the body's radius would cost digits of the squares.
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


@compiled
def _smaller_variance(moments: Moments) -> float:
    """Variance of the places along the direction in which they scatter least."""
    _, _, _, xx, xy, yy, _, _, _, _ = moments
    return 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)


@compiled
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


@compiled
def _by_principal_axes(
    moments: Moments,
    least: float,
    place_x: float,
    place_y: float,
    weight: float,
    result: FloatArray,
) -> float:
    """Fill in the determined direction, if there is one; return the remainder of hh."""
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
