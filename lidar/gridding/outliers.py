"""Rejection of returns off the surface: isolated returns, and outliers of a cell.

A false echo lies anywhere along the beam. In a cell with several returns it differs from the
others; in a cell with few only the cells around can show it. Their test must spare boulders: the
edge of a boulder departs from its neighbourhood too, but has a neighbour at its own height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.gridding.cells.cells import CellReturns
from lidar.gridding.neighbourhood import expect, supported
from spcola.arrays import (
    AnyArray,
    BoolArray,
    FloatArray,
    IntArray,
)
from spcola.compilation import compiled
from spcola.errors import SettingsError


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
        Least number of neighbours with a height for this test. Where returns are dense (more
        than `few` in the median cell) a return with fewer neighbours, beyond the edge of a
        raster, is isolated unless a cell next to it lies near its height.
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


def find_isolated(cells: CellReturns, gsd: float, options: RejectionOptions) -> BoolArray:
    """Return which returns (K,) no neighbouring cell supports, or lie on another sheet.

    The heights of the cells are plain medians here, since isolated returns must be removed
    before slopes are fitted.
    """
    place_x, place_y = cells.place
    height = cells.middle
    expected = expect(
        place_x,
        place_y,
        height,
        radius=options.neighbourhood,
        least_cells=options.least_cells,
    )
    # At the grid points, to which the cells' own slopes have not been applied yet.
    base = expected.height - expected.slope_x * place_x - expected.slope_y * place_y
    dense = _is_dense(cells.count, options.few)
    isolated, candidate = _candidates(
        cells.start,
        (cells.dx, cells.dy, cells.height),
        (expected.slope_x.ravel(), expected.slope_y.ravel(), base.ravel()),
        options.neighbourhood_sigmas * expected.scatter.ravel(),
        options.departure * gsd,
        options.few if dense else -options.few,
    )
    at = np.flatnonzero(candidate)
    cell = np.searchsorted(cells.start, at, side="right") - 1
    row, column = np.divmod(cell, cells.shape[1])
    value, step = cells.height[at], options.steepest * gsd
    if not dense:
        isolated[at] = ~supported(height, row, column, value, step)
        return isolated
    # Beyond the edge of a raster two isolated returns must not support each other: support starts
    # at cells that are not candidates, and propagates.
    sound = height.copy()
    sound[row, column] = np.nan
    found = np.zeros(len(at), dtype=np.bool_)
    while (more := ~found & supported(sound, row, column, value, step)).any():
        found |= more
        sound[row[more], column[more]] = height[row[more], column[more]]
    isolated[at] = ~found
    return isolated


@compiled
def _candidates(
    start: IntArray,
    local: tuple[FloatArray, FloatArray, FloatArray],
    expected: tuple[FloatArray, FloatArray, FloatArray],
    limit: FloatArray,
    departure: float,
    few: int,
) -> tuple[BoolArray, BoolArray]:
    """Masks (K,) of returns that depart too far, and of candidates in cells of few returns.

    Expected of each cell are slopes x and y, and the height at its grid point. With negative
    `few`, returns without an expectation (NaN) are no candidates.
    """
    dx, dy, height = local
    slope_x, slope_y, base = expected
    isolated = np.zeros(len(height), dtype=np.bool_)
    candidate = np.zeros(len(height), dtype=np.bool_)
    for c in range(len(start) - 1):
        some = slice(start[c], start[c + 1])
        x, y, h, away = dx[some], dy[some], height[some], isolated[some]
        for k in range(len(h)):
            away[k] = abs(h[k] - slope_x[c] * x[k] - slope_y[c] * y[k] - base[c]) > departure
        if len(h) > abs(few):
            continue
        for k in range(len(h)):
            distance = abs(h[k] - slope_x[c] * x[k] - slope_y[c] * y[k] - base[c])
            untestable = few > 0 and not np.isfinite(distance)
            candidate[start[c] + k] = (distance > limit[c] or untestable) and not away[k]
    return isolated, candidate


def _is_dense(count: AnyArray, few: int) -> bool:
    """Return whether the returns form a raster, not a track or single shots."""
    there = count[count > 0]
    return bool(there.size) and float(np.median(there)) > few


def find_outliers(
    cells: CellReturns,
    corrected: FloatArray,
    height: FloatArray,
    spread: FloatArray,
    gsd: float,
    options: RejectionOptions,
) -> BoolArray:
    """Mask (K,) of returns far from the surface `height` of their cell.

    `corrected` (K,) are the slope-corrected heights. The robust standard deviation of a cell,
    `spread`, is taken no smaller than the median of all cells: five returns may agree by
    chance.
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
