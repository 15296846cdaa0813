"""Which returns do not belong to the surface: strays, and outliers of a cell.

A stray echo lies anywhere along the beam. In a cell with several returns the others show it
up; in a cell with few only the cells around can, and they have to be asked fairly: the edge of
a boulder departs from its neighbourhood too, but it has a neighbour at its own height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.gridding.cells import CellReturns
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
    """When a return is an outlier.

    Parameters
    ----------
    cell_sigmas : float
        A return further from its cell's median than this many robust standard deviations of
        the cell is rejected, if the cell holds more than `few` returns; inf: never.
    few : int
        Cells with at most so many returns are judged by their neighbourhood instead.
    neighbourhood_sigmas : float
        A return in a cell with few returns must lie further than this many robust standard
        deviations from what its neighbourhood lets one expect …
    steepest : float
        … and further than this (dimensionless slope, times the distance) from each of the
        eight cells around it, to be a stray; inf: never.
    departure : float
        A return further than this from what its neighbourhood lets one expect, in GSD, is on
        another sheet of the ground (overhang, far wall) and is rejected, however many returns
        are there with it; inf: never.
    neighbourhood : int
        Half-width, in cells, of the neighbourhood.
    least_cells : int
        Fewer neighbours with a height than this cannot judge. Where returns lie densely (more
        than `few` in the middling cell) one that cannot be judged, beyond the edge of a raster,
        is a stray all the same unless a cell next to it lies near its height.
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


def find_strays(cells: CellReturns, gsd: float, options: RejectionOptions) -> BoolArray:
    """Mask (K,) of returns that nothing around their cell supports, or on another sheet.

    The heights of the cells are plain medians here: strays are to be out before slopes are
    fitted.
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
    # At the grid points, where the cells' own slopes have carried nothing yet.
    base = expected.height - expected.slope_x * place_x - expected.slope_y * place_y
    dense = _is_dense(cells.count, options.few)
    stray, suspect = _judged(
        cells.start,
        (cells.dx, cells.dy, cells.height),
        (expected.slope_x.ravel(), expected.slope_y.ravel(), base.ravel()),
        options.neighbourhood_sigmas * expected.scatter.ravel(),
        options.departure * gsd,
        options.few if dense else -options.few,
    )
    at = np.flatnonzero(suspect)
    cell = np.searchsorted(cells.start, at, side="right") - 1
    row, column = np.divmod(cell, cells.shape[1])
    value, step = cells.height[at], options.steepest * gsd
    if not dense:
        stray[at] = ~supported(height, row, column, value, step)
        return stray
    # Beyond the edge of a raster one stray must not vouch for another: support begins at cells
    # that are none, and is handed on.
    trusted = height.copy()
    trusted[row, column] = np.nan
    found = np.zeros(len(at), dtype=np.bool_)
    while (more := ~found & supported(trusted, row, column, value, step)).any():
        found |= more
        trusted[row[more], column[more]] = height[row[more], column[more]]
    stray[at] = ~found
    return stray


@compiled
def _judged(
    start: IntArray,
    local: tuple[FloatArray, FloatArray, FloatArray],
    expected: tuple[FloatArray, FloatArray, FloatArray],
    limit: FloatArray,
    departure: float,
    few: int,
) -> tuple[BoolArray, BoolArray]:
    """Masks (K,) of what departs too far, and of what is suspect in cells of few returns.

    Expected of each cell are slopes x and y, and the height at its grid point. `few` is negative
    where returns that cannot be judged (NaN) are above suspicion.
    """
    dx, dy, height = local
    slope_x, slope_y, base = expected
    stray = np.zeros(len(height), dtype=np.bool_)
    suspect = np.zeros(len(height), dtype=np.bool_)
    for c in range(len(start) - 1):
        some = slice(start[c], start[c + 1])
        x, y, h, away = dx[some], dy[some], height[some], stray[some]
        for k in range(len(h)):
            away[k] = abs(h[k] - slope_x[c] * x[k] - slope_y[c] * y[k] - base[c]) > departure
        if len(h) > abs(few):
            continue
        for k in range(len(h)):
            distance = abs(h[k] - slope_x[c] * x[k] - slope_y[c] * y[k] - base[c])
            unjudged = few > 0 and not np.isfinite(distance)
            suspect[start[c] + k] = (distance > limit[c] or unjudged) and not away[k]
    return stray, suspect


def _is_dense(count: AnyArray, few: int) -> bool:
    """Whether the returns are those of a raster, not of a track or of single shots."""
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
    `spread`, is taken no smaller than the median one of the grid's cells: five returns may agree
    by chance.
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
