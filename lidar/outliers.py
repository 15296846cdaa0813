"""Which returns do not belong to the surface: strays, and outliers of a cell.

A stray echo lies anywhere along the beam. In a cell with several returns the others show it
up; in a cell with few only the cells around can, and they have to be asked fairly: the edge of
a boulder departs from its neighbourhood too, but it has a neighbour at its own height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.cells import CellReturns
from lidar.neighbourhood import expect, supported
from spcola.arrays import AnyArray, BoolArray, FloatArray
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
    place_x, place_y = cells.medians(cells.dx), cells.medians(cells.dy)
    height = cells.medians(cells.height)
    expected = expect(
        place_x,
        place_y,
        height,
        radius=options.neighbourhood,
        least_cells=options.least_cells,
    )
    cell = cells.cell
    carried = (
        expected.height.ravel()[cell]
        + expected.slope_x.ravel()[cell] * (cells.dx - place_x.ravel()[cell])
        + expected.slope_y.ravel()[cell] * (cells.dy - place_y.ravel()[cell])
    )
    # NaN where the neighbourhood cannot judge: the comparisons are then false.
    distance = np.abs(cells.height - carried)
    stray: BoolArray = distance > options.departure * gsd
    suspect = distance > options.neighbourhood_sigmas * expected.scatter.ravel()[cell]
    dense = _is_dense(cells.count, options.few)
    if dense:
        suspect |= ~np.isfinite(distance)
    at = np.flatnonzero(suspect & ~stray & (cells.count.ravel()[cell] <= options.few))
    row, column = np.divmod(cell[at], cells.shape[1])
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


def _is_dense(count: AnyArray, few: int) -> bool:
    """Whether the returns are those of a raster, not of a track or of single shots."""
    there = count[count > 0]
    return bool(there.size) and float(np.median(there)) > few


def find_outliers(
    cells: CellReturns,
    corrected: FloatArray,
    height: FloatArray,
    gsd: float,
    options: RejectionOptions,
) -> BoolArray:
    """Mask (K,) of returns far from the surface `height` of their cell.

    `corrected` (K,) are the slope-corrected heights. The robust standard deviation of a cell is
    taken no smaller than the median one of the grid's cells: five returns may agree by chance.
    """
    cell = cells.cell
    distance = np.abs(corrected - height.ravel()[cell])
    many = cells.count > options.few
    spread = np.where(many, cells.spreads(corrected, height), np.nan)
    floor = float(np.median(spread[many])) if many.any() else 0.0
    limit = np.where(many, options.cell_sigmas * np.maximum(spread, floor), np.inf)
    # Identical heights (quantised ranges) have no spread: rounding must not reject them.
    outlier: BoolArray = distance > np.maximum(limit, 1e-6 * gsd).ravel()[cell]
    return outlier
