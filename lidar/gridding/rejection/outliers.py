"""Rejection of returns off the surface: isolated returns, and outliers of a cell.

A false echo lies anywhere along the beam. In a cell with several returns it differs from the
others; in a cell with few only the cells around can show it. Their test must spare boulders: the
edge of a boulder departs from its neighbourhood too, but has a neighbour at its own height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.gridding.cells.cells import CellReturns
from lidar.gridding.rejection.density import filled_around, needs_support
from lidar.gridding.rejection.neighbourhood import count_support, expect
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled
from spcola.errors import SettingsError

# A return in a window of which less than this share is filled lies beyond the rim of a raster. What
# departs there needs two neighbours near its height, not one: nothing on the other side judges it.
_RIM = 0.5


@dataclass(frozen=True)
class RejectionOptions:
    """Criteria for outliers.

    Parameters
    ----------
    cell_sigmas : float
        A return further from its cell's median than this many robust standard deviations of
        the cell is rejected, if the cell has more than `few` returns; inf: never.
    few : int
        Cells with at most so many returns are tested against their neighbourhood instead.
    neighbourhood_sigmas : float
        A return in a cell with few returns is isolated if it lies further than this many robust
        standard deviations from the height expected from its neighbourhood …
    steepest : float
        … and further than this (dimensionless slope, times the distance) from each of the
        eight cells around it; inf: never.
    departure : float
        A return further than this from the height expected from its neighbourhood, in GSD, is on
        another sheet of the ground (overhang, far wall) and is rejected, however many returns
        are there; inf: never.
    neighbourhood : int
        Half-width, in cells, of the neighbourhood.
    least_cells : int
        Least number of neighbours with a height for this test. In a scan that samples its ground
        densely (:mod:`~lidar.gridding.rejection.density`) a return with fewer neighbours, beyond
        the edge of a raster, is isolated unless a cell next to it lies near its height.
    max_rounds : int
        Most repetitions of either test.

    Raises
    ------
    SettingsError
        If a number is not positive.
    """

    cell_sigmas: float = 5.0
    few: int = 4
    neighbourhood_sigmas: float = 6.0
    steepest: float = 1.5
    departure: float = 10.0
    neighbourhood: int = 2
    least_cells: int = 6
    max_rounds: int = 5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise SettingsError(f"must be positive, not {value}", f"rejection.{name}")

    @classmethod
    def none(cls) -> RejectionOptions:
        """Return options that reject nothing."""
        return cls(cell_sigmas=np.inf, neighbourhood_sigmas=np.inf, departure=np.inf)


def find_isolated(
    cells: CellReturns, scan: IntArray, gsd: float, options: RejectionOptions
) -> BoolArray:
    """Return which returns (K,) no neighbouring cell supports, or lie on another sheet.

    The heights of the cells are plain medians here, since isolated returns must be removed
    before slopes are fitted. `scan` (K,) are the numbers of the scans of the returns in `cells`:
    where a scan is dense (see the module `density`) a return without a neighbourhood is isolated
    too. `gsd` is in metres; `options` are the criteria.
    """
    radius, least_cells = options.neighbourhood, options.least_cells
    place_x, place_y = cells.place
    expected = expect(place_x, place_y, cells.middle, radius=radius, least_cells=least_cells)
    # At the grid points, to which the cells' own slopes have not been applied yet.
    base = expected.height - expected.slope_x * place_x - expected.slope_y * place_y
    away, limit, scarce = _departures(
        cells.start,
        (cells.dx, cells.dy, cells.height),
        (expected.slope_x.ravel(), expected.slope_y.ravel(), base.ravel()),
        options.neighbourhood_sigmas * expected.scatter.ravel(),
        options.few,
    )
    isolated: BoolArray = away > options.departure * gsd
    scarce &= ~isolated
    departing = np.flatnonzero(scarce & (away > limit))
    alone = np.flatnonzero(scarce & np.isnan(away))
    if not len(departing) and not len(alone):
        return isolated
    tests = np.isfinite(away), away <= limit
    needed = needs_support(cells, scan, tests, options.few, (radius, least_cells))
    beyond = needed[departing] & _beyond_rim(cells, departing, radius)
    least = np.where(beyond, 2, 1)
    step = options.steepest * gsd
    isolated[_unsupported(cells, (departing, least), alone[needed[alone]], step)] = True
    return isolated


def _beyond_rim(cells: CellReturns, number: IntArray, radius: int) -> BoolArray:
    """Return which of the returns of this `number` lie beyond the rim of a raster."""
    around = filled_around(cells.count, radius).ravel()[cells.cell[number]]
    beyond: BoolArray = around < _RIM * (2 * radius + 1) ** 2
    return beyond


@compiled
def _departures(
    start: IntArray,
    local: tuple[FloatArray, FloatArray, FloatArray],
    expected: tuple[FloatArray, FloatArray, FloatArray],
    limit: FloatArray,
    few: int,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Distances (K,) from the expected heights, their limits, and which lie in cells of few.

    Expected of each cell are slopes x and y, and the height at its grid point; NaN where its
    neighbourhood is too small.
    """
    dx, dy, height = local
    slope_x, slope_y, base = expected
    away, limits = np.empty(len(height)), np.empty(len(height))
    scarce = np.empty(len(height), dtype=np.bool_)
    for c in range(len(start) - 1):
        for k in range(start[c], start[c + 1]):
            away[k] = abs(height[k] - slope_x[c] * dx[k] - slope_y[c] * dy[k] - base[c])
            limits[k] = limit[c]
            scarce[k] = start[c + 1] - start[c] <= few
    return away, limits, scarce


def _unsupported(
    cells: CellReturns, departing: tuple[IntArray, IntArray], alone: IntArray, step: float
) -> IntArray:
    """Return which of the returns numbered `departing` and `alone` no cell next to them supports.

    Departing ones, with the number of cells that each needs, support each other, since they may
    be a boulder. Those without a neighbourhood do not, since false echoes may be neighbours by
    chance: their support starts at other cells, and propagates.
    """
    number, least = departing
    sound = cells.middle.copy()

    def place(some: IntArray) -> tuple[IntArray, IntArray]:
        row, column = np.divmod(cells.cell[some], cells.shape[1])
        return row, column

    sound[place(alone)] = np.nan
    value = cells.height
    lost = number[count_support(sound, *place(number), value[number], step) < least]
    sound[place(lost)] = np.nan
    while len(alone):
        found = count_support(sound, *place(alone), value[alone], step) > 0
        if not found.any():
            break
        row, column = place(alone[found])
        sound[row, column] = cells.middle[row, column]
        alone = alone[~found]
    return np.concatenate([lost, alone])


def find_outliers(
    cells: CellReturns,
    corrected: FloatArray,
    height: FloatArray,
    spread: FloatArray,
    gsd: float,
    options: RejectionOptions,
) -> BoolArray:
    """Return which returns (K,) of `cells` lie far from the surface `height` (R, C), by `options`.

    `corrected` (K,) are their slope-corrected heights, `gsd` the grid's step, metres. The robust
    standard deviation of a cell, `spread` (R, C), is taken no smaller than the median of all cells:
    five returns may agree by chance.
    """
    many = cells.count > options.few
    floor = float(np.median(spread[many])) if many.any() else 0.0
    limit = np.where(many, options.cell_sigmas * np.maximum(spread, floor), np.inf)
    # Identical heights (quantised ranges) have no spread: rounding must not reject them.
    limit = np.maximum(limit, 1e-6 * gsd)
    return _beyond(cells.start, corrected, height.ravel(), limit.ravel())


@compiled
def _beyond(
    start: IntArray, values: FloatArray, center: FloatArray, limit: FloatArray
) -> BoolArray:
    """Mask (K,) of the values further than its limit from the center of their cell (C,)."""
    beyond = np.zeros(len(values), dtype=np.bool_)
    for c in range(len(start) - 1):
        for k in range(start[c], start[c + 1]):
            beyond[k] = abs(values[k] - center[c]) > limit[c]
    return beyond
