"""Expected height of a cell from the cells around it, by medians, which resist outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.gridding.cells.medians import column_medians, median_of, middle_network
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.math.robust import MAD_TO_SIGMA


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expectation at each cell's place from the cells around it; NaN where there are too few.

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
    """Return the expected height of every cell by medians over (2 radius + 1)² − 1 neighbours.

    Slopes are medians of the differences between adjacent cells, heights medians of the
    neighbours' heights moved along these slopes: up to about a third of the neighbours may be
    outliers without harm. Cells with fewer than `least_cells` neighbours get NaN.
    """
    layers = np.full((4, *height.shape), np.nan)
    whole = np.zeros(height.shape, dtype=np.bool_)
    width = 2 * radius + 1
    if width**2 > least_cells and min(height.shape) >= width:
        networks = (middle_network(width * (width - 1) - 2), middle_network(width**2 - 1))
        _expect_in_whole(place_x, place_y, height, radius, networks, whole, layers)
    _expect(place_x, place_y, height, radius, least_cells, whole, layers)
    return Expectation(*layers)


@compiled
def _expect_in_whole(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    radius: int,
    networks: tuple[IntArray, IntArray],
    whole: BoolArray,
    layers: FloatArray,
) -> None:
    """Fill the layers where all cells of the window have heights, and mark these in `whole`.

    Same as :func:`_expect`, a row at a time.
    """
    rows, columns = height.shape
    width, wide = 2 * radius + 1, columns - 2 * radius
    steps, carried = np.empty((width * (width - 1) - 2, wide)), np.empty((width**2 - 1, wide))
    around = np.empty(wide)
    for row in range(radius, rows - radius):
        here = slice(radius, columns - radius)
        slope_x, slope_y = layers[1, row, here], layers[2, row, here]
        _list_steps(height, row, radius, 0, 1, steps)
        column_medians(steps, networks[0], slope_x)
        _list_steps(height, row, radius, 1, 0, steps)
        column_medians(steps, networks[0], slope_y)
        around[:] = height[row, here]
        n = 0
        for down in range(-radius, radius + 1):
            for right in range(-radius, radius + 1):
                if down == 0 and right == 0:
                    continue
                there = slice(radius + right, columns - radius + right)
                heights = (height[row + down, there], slope_x, slope_y)
                step_x = (place_x[row, here], right, place_x[row + down, there])
                step_y = (place_y[row, here], down, place_y[row + down, there])
                _carry(heights, step_x, step_y, carried[n], around)
                n += 1
        expected = layers[0, row, here]
        column_medians(carried, networks[1], expected)
        for k in range(n):
            _take_off(carried[k], expected)
        column_medians(carried, networks[1], layers[3, row, here])
        for j in range(wide):
            # One NaN among the heights makes this sum NaN.
            whole[row, j + radius] = not np.isnan(around[j])
            for layer in range(4):
                value = layers[layer, row, j + radius]
                value *= MAD_TO_SIGMA if layer == 3 else 1.0
                layers[layer, row, j + radius] = value if whole[row, j + radius] else np.nan


@compiled_inline
def _carry(
    heights: tuple[FloatArray, FloatArray, FloatArray],
    step_x: tuple[FloatArray, int, FloatArray],
    step_y: tuple[FloatArray, int, FloatArray],
    carried: FloatArray,
    around: FloatArray,
) -> None:
    """Move the heights of one neighbour of each cell of a row to the cells, and add them up.

    `heights` include the slopes there; a step is the cell's place less that of its neighbour.
    """
    height, slope_x, slope_y = heights
    here_x, right, there_x = step_x
    here_y, down, there_y = step_y
    for j in range(len(carried)):
        x, y = (here_x[j] - right) - there_x[j], (here_y[j] - down) - there_y[j]
        carried[j] = height[j] + slope_x[j] * x + slope_y[j] * y
        around[j] += carried[j]


@compiled_inline
def _take_off(values: FloatArray, center: FloatArray) -> None:
    """Replace values by their distances from a center."""
    for j in range(len(values)):
        values[j] = abs(values[j] - center[j])


@compiled
def _list_steps(
    height: FloatArray, row: int, radius: int, down: int, right: int, steps: FloatArray
) -> None:
    """Differences of neighbours in the windows of a row, without those of the middle cell."""
    wide = steps.shape[1]
    n = 0
    for r in range(-radius, radius + 1 - down):
        for c in range(-radius, radius + 1 - right):
            if (r == 0 and c == 0) or (r + down == 0 and c + right == 0):
                continue
            near = height[row + r, radius + c :]
            far = height[row + r + down, radius + c + right :]
            for j in range(wide):
                steps[n, j] = far[j] - near[j]
            n += 1


@compiled
def _expect(
    place_x: FloatArray,
    place_y: FloatArray,
    height: FloatArray,
    radius: int,
    least_cells: int,
    done: BoolArray,
    layers: FloatArray,
) -> None:
    """Fill the layers of the cells that are not `done`."""
    rows, columns = height.shape
    height = height.copy()
    buffer = np.empty((2 * radius + 1) ** 2)
    for row in range(rows):
        for column in range(columns):
            if np.isnan(height[row, column]) or done[row, column]:
                continue
            window = (
                max(0, row - radius),
                min(rows, row + radius + 1),
                max(0, column - radius),
                min(columns, column + radius + 1),
            )
            # The cell itself is left out of its expectation.
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


@compiled
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


@compiled
def count_support(
    height: FloatArray, row: IntArray, column: IntArray, value: FloatArray, step: float
) -> IntArray:
    """Return to how many of the eight cells around (row, column) each value (N,) is close.

    Close means within `step` metres for each grid step of distance: the edge of a boulder has a
    neighbour at its own height, an isolated echo has none.
    """
    rows, columns = height.shape
    result = np.zeros(len(value), dtype=np.int64)
    for i in range(len(value)):
        for r in range(max(0, row[i] - 1), min(rows, row[i] + 2)):
            for c in range(max(0, column[i] - 1), min(columns, column[i] + 2)):
                distance = np.hypot(r - row[i], c - column[i])
                if distance > 0 and abs(height[r, c] - value[i]) <= step * distance:
                    result[i] += 1
    return result
