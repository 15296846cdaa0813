"""Returns to mapolas: the median of the slope-corrected heights in each cell.

Isolated returns are removed first; slopes and medians are iterated
(:mod:`lidar.gridding.iteration`); outliers of the cells are removed, and the iteration is repeated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.gridding.cells import CellReturns, sort_into_cells
from lidar.gridding.iteration import IteratedSurface, iterate_surface
from lidar.gridding.mapola import Mapola
from lidar.gridding.options import GriddingOptions
from lidar.gridding.rejection import find_isolated, find_outliers
from lidar.gridding.sigma import height_sigma
from lidar.scans import Returns
from spcola.arrays import BoolArray, IntArray
from spcola.compilation import compiled
from spcola.grids import MapletGrid


@dataclass(frozen=True)
class GriddingReport:
    """Counts of the returns of one mapola, and the end of its iteration.

    Attributes
    ----------
    offered : int
        Returns that were given.
    ignored : int
        Outside the grid, or beyond its reach along Uz.
    isolated : int
        Rejected because no neighbouring cell supports them (in cells with few returns).
    outlying : int
        Rejected because they lie far from the other returns of their cell.
    emptied : int
        Cells that lost all their returns.
    iterations : int
        Rounds of slopes and medians of the last pass.
    largest_change_m : float
        Largest change of a height in the last round, metres.
    converged : bool
    reason : str
        Why the iteration stopped.
    """

    offered: int
    ignored: int
    isolated: int = 0
    outlying: int = 0
    emptied: int = 0
    iterations: int = 0
    largest_change_m: float = 0.0
    converged: bool = True
    reason: str = ""

    @property
    def used(self) -> int:
        """Number of returns in the heights."""
        return self.offered - self.ignored - self.isolated - self.outlying


@dataclass(frozen=True, eq=False)
class Gridding:
    """A mapola with a report.

    Attributes
    ----------
    mapola : Mapola
    report : GriddingReport
    used : (N,) ndarray of bool
        Which of the returns are in the heights.
    """

    mapola: Mapola
    report: GriddingReport
    used: BoolArray


def make_mapola(
    name: str, grid: MapletGrid, returns: Returns, *, options: GriddingOptions | None = None
) -> Mapola:
    """Grid `returns` on `grid` with `options`: the mapola `name` of :func:`grid_returns`."""
    return grid_returns(name, grid, returns, options=options).mapola


def grid_returns(
    name: str, grid: MapletGrid, returns: Returns, *, options: GriddingOptions | None = None
) -> Gridding:
    """Grid `returns` on `grid` by iterated slope-corrected medians [35, 36].

    The result does not depend on the order of the returns. A grid on which no return falls
    gives a mapola without heights.

    Parameters
    ----------
    name : str
        Of the mapola.
    grid : MapletGrid
    returns : Returns
        Body-fixed, metres; those outside the grid are ignored.
    options : GriddingOptions, optional

    Returns
    -------
    Gridding
        The mapola, and a report of what was rejected.
    """
    options = options or GriddingOptions()
    cells = sort_into_cells(grid, returns.points, options.reach(grid))
    if not len(cells.index):
        return _nothing(name, grid, len(returns))
    inside, count = len(cells.index), cells.count
    cells = _without_isolated(cells, returns.scan, grid.gsd, options)
    isolated, outlying = inside - len(cells.index), 0
    surface = iterate_surface(cells, grid.gsd, options)
    for _ in range(options.rejection.max_rounds):
        outlier = find_outliers(
            surface.cells,
            surface.corrected,
            surface.height,
            surface.spread,
            grid.gsd,
            options.rejection,
        )
        if not outlier.any():
            break
        outlying += int(np.count_nonzero(outlier))
        surface = iterate_surface(surface.cells.reduced(~outlier), grid.gsd, options, start=surface)
    report = GriddingReport(
        offered=len(returns),
        ignored=len(returns) - inside,
        isolated=isolated,
        outlying=outlying,
        emptied=int(np.count_nonzero((count > 0) & (surface.cells.count == 0))),
        iterations=surface.iterations,
        largest_change_m=surface.change,
        converged=surface.converged,
        reason="no height changes any more"
        if surface.converged
        else f"the limit of {options.max_iterations} iterations was reached",
    )
    return _finish(name, grid, returns, surface, report, options)


def _nothing(name: str, grid: MapletGrid, offered: int) -> Gridding:
    """Return the empty mapola of a grid on which no return falls."""
    unknown = np.full(grid.shape, np.nan)
    mapola = Mapola(
        name,
        grid,
        unknown,
        sigma=unknown,
        count=np.zeros(grid.shape, dtype=np.int64),
        spread=unknown,
        scan_share={},
    )
    report = GriddingReport(offered, ignored=offered, reason="no return falls on the grid")
    return Gridding(mapola, report, np.zeros(offered, dtype=np.bool_))


def _without_isolated(
    cells: CellReturns, scan: IntArray, gsd: float, options: GriddingOptions
) -> CellReturns:
    """Remove isolated returns from cells with few returns, in place."""
    for _ in range(options.rejection.max_rounds):
        isolated = find_isolated(cells, scan[cells.index], gsd, options.rejection)
        if not isolated.any():
            break
        cells = cells.reduced(~isolated)
    return cells


def _finish(
    name: str,
    grid: MapletGrid,
    returns: Returns,
    surface: IteratedSurface,
    report: GriddingReport,
    options: GriddingOptions,
) -> Gridding:
    """Make the mapola of a surface."""
    cells = surface.cells
    used = _marked(cells.index, len(returns))
    spread = np.where(cells.count >= 3, surface.spread, np.nan)
    sigma = height_sigma(
        cells,
        returns.sigma,
        spread,
        surface.planes,
        surface.height,
        default=options.default_sigma_m,
    )
    mapola = Mapola(
        name,
        grid,
        surface.height,
        sigma=sigma,
        count=cells.count,
        spread=spread,
        scan_share=_scan_share(returns, used),
    )
    return Gridding(mapola, report, used)


def _scan_share(returns: Returns, used: BoolArray) -> dict[str, float]:
    """Share of the returns `used` that came from each scan (those that gave any)."""
    numbers = _counted(returns.scan, used, len(returns.scan_names))
    total = max(1, int(numbers.sum()))
    return {
        name: float(number / total)
        for name, number in zip(returns.scan_names, numbers, strict=True)
        if number
    }


@compiled
def _marked(index: IntArray, count: int) -> BoolArray:
    """Mask (count,) with True at the numbers in `index`."""
    marked = np.zeros(count, dtype=np.bool_)
    for k in index:
        marked[k] = True
    return marked


@compiled
def _counted(numbers: IntArray, chosen: BoolArray, most: int) -> IntArray:
    """Count each number from 0 on, below `most`, among the chosen of `numbers` (N,)."""
    counts = np.zeros(most, dtype=np.int64)
    for i in range(len(numbers)):
        counts[numbers[i]] += chosen[i]
    return counts
