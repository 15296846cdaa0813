"""Returns sorted into the cells of a grid, and exact statistics of each cell.

A cell is the square of one GSD around a grid point. The returns are brought into cell order once,
by a counting sort; medians are then found cell by cell, so that a whole grid costs O(N) however
often the iteration needs it. Medians do not depend on the order of the returns.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lidar.gridding.cells.medians import run_medians
from lidar.gridding.cells.sorting import MANY, sort_points
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline, usable_threads
from spcola.grids import MapletGrid
from spcola.math.robust import MAD_TO_SIGMA


@dataclass(frozen=True, eq=False)
class CellReturns:
    """K returns in the order of the C = (2q+1)² cells of a grid.

    Attributes
    ----------
    shape : (int, int)
        Shape of the grid's arrays.
    start : (C + 1,) ndarray of int
        The returns of cell c (row-major) are start[c] … start[c + 1] − 1.
    dx, dy : (K,) ndarrays
        Place of the return less that of its grid point along Ux and Uy, grid steps.
    height : (K,) ndarray
        Along Uz, metres.
    index : (K,) ndarray of int
        Number of each among the original returns.
    """

    shape: tuple[int, int]
    start: IntArray
    dx: FloatArray
    dy: FloatArray
    height: FloatArray
    index: IntArray

    @property
    def count(self) -> IntArray:
        """Returns in each cell, of the grid's shape."""
        return np.diff(self.start).reshape(self.shape)

    @cached_property
    def cell(self) -> IntArray:
        """Cell (row-major) of each return (K,)."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    @cached_property
    def place(self) -> tuple[FloatArray, FloatArray]:
        """Mean place of each cell's returns less its grid point, grid steps; NaN if empty."""
        return self.means(self.dx), self.means(self.dy)

    @cached_property
    def middle(self) -> FloatArray:
        """Median of the heights in each cell, metres, of the grid's shape; NaN if empty."""
        return self.medians(self.height)

    def select(self, keep: BoolArray) -> CellReturns:
        """Return the returns chosen by the mask `keep` (K,)."""
        local = (self.dx.copy(), self.dy.copy(), self.height.copy())
        return self._moved_together(keep, local, self.index.copy())

    def reduced(self, keep: BoolArray) -> CellReturns:
        """Return the returns chosen by the mask `keep` (K,), in the memory of all of them.

        The original is destroyed: on large grids most of the time of a selection is copying.
        """
        return self._moved_together(keep, (self.dx, self.dy, self.height), self.index)

    def _moved_together(
        self, keep: BoolArray, local: tuple[FloatArray, FloatArray, FloatArray], index: IntArray
    ) -> CellReturns:
        start = _move_together(self.start, local, index, keep)
        dx, dy, height = (values[: start[-1]] for values in local)
        chosen = CellReturns(self.shape, start, dx, dy, height, index[: start[-1]])
        chosen._inherit(self)
        return chosen

    def _inherit(self, before: CellReturns) -> None:
        """Reuse statistics computed `before` for cells that have lost no return since."""
        lost = np.flatnonzero(np.diff(self.start) != np.diff(before.start))
        known = vars(before)
        if "place" in known:
            place = tuple(layer.copy() for layer in before.place)
            for layer, values in zip(place, (self.dx, self.dy), strict=True):
                _means_of(self.start, values, lost, layer.ravel())
            vars(self)["place"] = place
        if "middle" in known:
            middle = before.middle.copy()
            run_medians(self.start, self.height, lost, middle.ravel())
            vars(self)["middle"] = middle

    def medians(self, values: FloatArray) -> FloatArray:
        """Exact median of `values` (K,) in each cell, of the grid's shape; NaN if empty."""
        return self._by_cell(_all_medians, values)

    def means(self, values: FloatArray) -> FloatArray:
        """Mean of `values` (K,) in each cell, of the grid's shape; NaN if empty."""
        return self._by_cell(_all_means, values)

    def _by_cell(
        self, statistic: Callable[[IntArray, FloatArray], FloatArray], values: FloatArray
    ) -> FloatArray:
        """Compute a statistic for every cell, of the grid's shape; for many returns on threads."""
        if len(values) < MANY:
            return statistic(self.start, values).reshape(self.shape)
        # The starts alone define the cells.
        threads = usable_threads()
        ends = np.linspace(0, len(self.start) - 1, threads + 1).astype(np.int64)
        with ThreadPoolExecutor(threads) as pool:
            parts = pool.map(
                lambda part: statistic(self.start[part[0] : part[1] + 1], values), pairwise(ends)
            )
            return np.concatenate(list(parts)).reshape(self.shape)

    def corrected(
        self, slope_x: FloatArray, slope_y: FloatArray, *, out: FloatArray | None = None
    ) -> FloatArray:
        """Heights (K,) moved to the grid points with slopes in metres per step [36].

        Parameters
        ----------
        slope_x, slope_y : (R, C) ndarrays
            Of each cell, metres per grid step.
        out : (K,) ndarray, optional
            Where the result is written.
        """
        result = np.empty(len(self.height)) if out is None else out
        local = (self.dx, self.dy, self.height)
        every = np.arange(len(self.start) - 1)
        _correct_some(self.start, local, (slope_x.ravel(), slope_y.ravel()), every, result)
        return result

    def spreads(self, values: FloatArray, center: FloatArray) -> FloatArray:
        """1.4826 × median absolute deviation of `values` (K,) from `center`, by cell."""
        spread = np.empty(len(self.start) - 1)
        every = np.arange(len(spread))
        run_medians(self.start, values, every, spread, center=center.ravel())
        return MAD_TO_SIGMA * spread.reshape(self.shape)


class CorrectedMedians:
    """Medians of the slope-corrected heights [36] during an iteration of the slopes.

    The iteration converges in most cells long before the last ones: a cell whose slopes have
    hardly changed since its median was computed keeps that median.

    Parameters
    ----------
    cells : CellReturns
    neglected_m : float
        A change of the slopes that moves heights by less than this over half a cell is ignored,
        metres.
    before : CorrectedMedians, optional
        Those of cells with more returns: cells that lost none keep their medians.
    """

    def __init__(
        self, cells: CellReturns, neglected_m: float, before: CorrectedMedians | None = None
    ) -> None:
        self._cells, self._neglected = cells, 2.0 * neglected_m
        self._slope_x, self._slope_y, self._height = (np.full(cells.shape, np.nan) for _ in "xyz")
        self._corrected = np.empty(len(cells.height))
        if before is not None:
            same = before._cells.count == cells.count
            self._slope_x[same] = before._slope_x[same]
            self._slope_y[same] = before._slope_y[same]
            self._height[same] = before._height[same]

    def at(self, slope_x: FloatArray, slope_y: FloatArray) -> FloatArray:
        """Median height of each cell with slopes in metres per step, of the grid's shape."""
        cells, slopes = self._cells, (self._slope_x.ravel(), self._slope_y.ravel())
        some = _follow(slopes, (slope_x.ravel(), slope_y.ravel()), self._neglected)
        _correct_some(
            cells.start, (cells.dx, cells.dy, cells.height), slopes, some, self._corrected
        )
        run_medians(cells.start, self._corrected, some, self._height.ravel())
        return self._height.copy()

    def of_returns(self, slope_x: FloatArray, slope_y: FloatArray) -> FloatArray:
        """Heights (K,) of all returns with these slopes; invalidates the medians."""
        return self._cells.corrected(slope_x, slope_y, out=self._corrected)


def sort_into_cells(grid: MapletGrid, points: FloatArray, reach: float) -> CellReturns:
    """Bring points (N, 3), metres, into the cells of their nearest grid points.

    Points outside the grid and those further than `reach` metres from its plane (the far side
    of the body is under every maplet) are left out.
    """
    frame = (grid.center, grid.axes / np.array([[grid.gsd], [grid.gsd], [1.0]]))
    points = np.asarray(points, dtype=np.float64)
    start, index, local = sort_points(points, frame, grid.half_size, reach)
    return CellReturns(grid.shape, start, local[0], local[1], local[2], index)


def _all_medians(start: IntArray, values: FloatArray) -> FloatArray:
    """Median of each run of `values` (K,) given by `start` (C + 1,)."""
    medians = np.empty(len(start) - 1)
    run_medians(start, values, np.arange(len(medians)), medians)
    return medians


@compiled
def _move_together(
    start: IntArray,
    local: tuple[FloatArray, FloatArray, FloatArray],
    index: IntArray,
    keep: BoolArray,
) -> IntArray:
    """Move the kept returns to the front, in their order; return the new starts of the cells."""
    dx, dy, height = local
    begins = np.zeros(len(start), dtype=np.int64)
    at = 0
    for c in range(len(start) - 1):
        for k in range(start[c], start[c + 1]):
            dx[at], dy[at], height[at], index[at] = dx[k], dy[k], height[k], index[k]
            at += keep[k]
        begins[c + 1] = at
    return begins


@compiled_inline
def _correct(
    first: int,
    end: int,
    local: tuple[FloatArray, FloatArray, FloatArray],
    slope_x: float,
    slope_y: float,
    result: FloatArray,
) -> None:
    """Move heights of one cell to its grid point."""
    # For slices the compiler knows that no index is negative, and vectorises.
    dx, dy, height = local[0][first:end], local[1][first:end], local[2][first:end]
    carried = result[first:end]
    for k in range(len(carried)):
        carried[k] = height[k] - slope_x * dx[k] - slope_y * dy[k]


@compiled
def _follow(
    slopes: tuple[FloatArray, FloatArray], new: tuple[FloatArray, FloatArray], neglected: float
) -> IntArray:
    """Update the slopes of cells (C,) where they changed; return these cells."""
    some = np.empty(len(slopes[0]), dtype=np.int64)
    count = 0
    for c in range(len(some)):
        moved = abs(new[0][c] - slopes[0][c]) + abs(new[1][c] - slopes[1][c])
        if not moved <= neglected:  # NaN, before the first time, differs from everything
            slopes[0][c], slopes[1][c] = new[0][c], new[1][c]
            some[count] = c
            count += 1
    return some[:count]


@compiled
def _correct_some(
    start: IntArray,
    local: tuple[FloatArray, FloatArray, FloatArray],
    slopes: tuple[FloatArray, FloatArray],
    cells: IntArray,
    result: FloatArray,
) -> None:
    """Move the heights of some cells (M,) to their grid points."""
    slope_x, slope_y = slopes
    for c in cells:
        _correct(start[c], start[c + 1], local, slope_x[c], slope_y[c], result)


def _all_means(start: IntArray, values: FloatArray) -> FloatArray:
    """Mean of each run of `values` (K,) given by `start` (C + 1,)."""
    means = np.empty(len(start) - 1)
    _means_of(start, values, np.arange(len(means)), means)
    return means


@compiled
def _means_of(start: IntArray, values: FloatArray, runs: IntArray, out: FloatArray) -> None:
    """Write the means of some runs of `values` (K,), by compensated summation.

    The compensated sum (Neumaier 1974) makes the mean correctly rounded for all practical purposes,
    so that it does not depend on the order of the returns.
    """
    for c in runs:
        total, lost = 0.0, 0.0
        for i in range(start[c], start[c + 1]):
            value = values[i]
            new = total + value
            if abs(total) >= abs(value):
                lost += (total - new) + value
            else:
                lost += (value - new) + total
            total = new
        size = start[c + 1] - start[c]
        out[c] = (total + lost) / size if size else np.nan
