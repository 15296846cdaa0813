"""What the cells around a cell let one expect there, by medians that strays do not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.medians import median_of
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.kernel import kernel
from spcola.robust import MAD_TO_SIGMA


@dataclass(frozen=True, eq=False)
class Expectation:
    """What the cells around each cell let one expect at its place; NaN where too few.

    Attributes
    ----------
    height : ndarray
        Metres, at the cell's place.
    slope_x, slope_y : ndarrays
        Median slopes, metres per grid step.
    scatter : ndarray
        Robust standard deviation of the neighbours about the expectation, metres.
    """

    height: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray
    scatter: FloatArray


def expect(
    place_x: FloatArray, place_y: FloatArray, height: FloatArray, *, radius: int, least_cells: int
) -> Expectation:
    """Expect a height in every cell from medians over its (2 radius + 1)² − 1 neighbours.

    Slopes are medians of the differences between adjacent cells, heights medians of the
    neighbours carried along these slopes: up to about a third of the neighbours may be stray
    without harm. Cells with fewer than `least_cells` neighbours get NaN.
    """
    layers = _expect(place_x, place_y, height, radius, least_cells)
    return Expectation(layers[0], layers[1], layers[2], layers[3])


@kernel
def _expect(
    place_x: FloatArray, place_y: FloatArray, height: FloatArray, radius: int, least_cells: int
) -> FloatArray:
    rows, columns = height.shape
    height = height.copy()
    layers = np.full((4, rows, columns), np.nan)
    buffer = np.empty((2 * radius + 1) ** 2)
    for row in range(rows):
        for column in range(columns):
            if np.isnan(height[row, column]):
                continue
            window = (
                max(0, row - radius),
                min(rows, row + radius + 1),
                max(0, column - radius),
                min(columns, column + radius + 1),
            )
            # What is judged has no say in what is expected of it.
            own, height[row, column] = height[row, column], np.nan
            slope_x = _median_step(height, window, 0, 1, buffer)
            slope_y = _median_step(height, window, 1, 0, buffer)
            height[row, column] = own
            size = 0
            for r in range(window[0], window[1]):
                for c in range(window[2], window[3]):
                    if (r != row or c != column) and not np.isnan(height[r, c]):
                        step_x = column - c + place_x[row, column] - place_x[r, c]
                        step_y = row - r + place_y[row, column] - place_y[r, c]
                        buffer[size] = height[r, c] + slope_x * step_x + slope_y * step_y
                        size += 1
            if size < least_cells:
                continue
            expected = median_of(buffer, size)
            for i in range(size):
                buffer[i] = abs(buffer[i] - expected)
            layers[0, row, column] = expected
            layers[1, row, column] = slope_x
            layers[2, row, column] = slope_y
            layers[3, row, column] = MAD_TO_SIGMA * median_of(buffer, size)
    return layers


@kernel
def _median_step(
    height: FloatArray,
    window: tuple[int, int, int, int],
    down: int,
    right: int,
    buffer: FloatArray,
) -> float:
    """Median difference between cells that are neighbours along one axis; 0 if there is none."""
    size = 0
    for r in range(window[0], window[1] - down):
        for c in range(window[2], window[3] - right):
            step = height[r + down, c + right] - height[r, c]
            if not np.isnan(step):
                buffer[size] = step
                size += 1
    return median_of(buffer, size) if size > 0 else 0.0


@kernel
def supported(
    height: FloatArray, row: IntArray, column: IntArray, value: FloatArray, step: float
) -> BoolArray:
    """Mask (N,) of values that one of the eight cells around (row, column) comes close to.

    Close means within `step` metres for each grid step of distance: the edge of a boulder has
    a neighbour at its own height, a stray echo has none.
    """
    rows, columns = height.shape
    result = np.zeros(len(value), dtype=np.bool_)
    for i in range(len(value)):
        for r in range(max(0, row[i] - 1), min(rows, row[i] + 2)):
            for c in range(max(0, column[i] - 1), min(columns, column[i] + 2)):
                distance = np.hypot(r - row[i], c - column[i])
                if distance > 0 and abs(height[r, c] - value[i]) <= step * distance:
                    result[i] = True
    return result
