"""Returns to mapolas: the median of the slope-corrected heights in each cell.

The iteration is that of Gaskell et al., eq. 35 and 36: each return is projected into the grid's
frame and assigned to its nearest grid point; its height is moved to that point with the slope of
the current surface; the median of a cell is the new surface; and so on until nothing changes.
([35] is printed with Ux for the height; it is Uz.)

The slope of a cell is that of a plane through the 3 × 3 cells around it, fitted not at their
grid points but where their returns lie (see :mod:`lidar.gridding.cells.planes`). Compared with
differences of the gridded heights this averages noise over nine cells, tolerates gaps, and makes
the iteration converge quickly: a plane is recovered exactly from returns at any places.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lidar.gridding.cells.cells import CellReturns, CorrectedMedians, sort_into_cells
from lidar.gridding.cells.planes import PlaneFit
from lidar.gridding.cells.windows import PlaneWindows
from lidar.gridding.mapola import Mapola
from lidar.gridding.outliers import RejectionOptions, find_isolated, find_outliers
from lidar.gridding.sigma import height_sigma
from lidar.scans import Returns
from lidar.scans.cubes import Box
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled
from spcola.errors import SettingsError
from spcola.grids import MapletGrid

# Rounds before the iteration takes half steps.
_FULL_STEPS = 10
# A median is unchanged where new slopes would move it by less than this share of the tolerance.
_NEGLECTED = 0.05


@dataclass(frozen=True)
class GriddingOptions:
    """Settings of the gridding of returns.

    Parameters
    ----------
    tolerance : float
        The iteration ends when no height changes by more than this, in GSD.
    max_iterations : int
        Most rounds of slopes and medians (for each set of accepted returns).
    baseline : float
        Least scatter of the cells' places (standard deviation, grid steps) along a direction in
        which a slope is fitted; below it a wider window is used.
    max_window : int
        Largest half-width, in cells, of the window in which slopes are fitted.
    reach_m : float, optional
        Returns further than this from the grid's plane belong to another part of the body and
        are ignored, metres; by default half the grid's width.
    default_sigma_m : float
        Standard deviation of a single return where neither the returns nor their spread in the
        neighbourhood determine it, metres.
    rejection : RejectionOptions
        Criteria for outliers.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    tolerance: float = 1e-4
    max_iterations: int = 50
    baseline: float = 0.3
    max_window: int = 3
    reach_m: float | None = None
    default_sigma_m: float = 0.1
    rejection: RejectionOptions = field(default_factory=RejectionOptions)

    def __post_init__(self) -> None:
        for name in ("tolerance", "max_iterations", "baseline", "max_window", "default_sigma_m"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"must be positive, not {getattr(self, name)}", name)
        if self.reach_m is not None and not self.reach_m > 0:
            raise SettingsError(f"must be positive, not {self.reach_m}", "reach_m")

    def reach(self, grid: MapletGrid) -> float:
        """Return the largest distance from the plane of `grid` that is used, metres."""
        return self.reach_m or grid.half_size * grid.gsd

    def box(self, grid: MapletGrid) -> Box:
        """Return the box that contains all returns which can fall on `grid`."""
        return Box.over(grid, self.reach(grid))


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
    isolated: int
    outlying: int
    emptied: int
    iterations: int
    largest_change_m: float
    converged: bool
    reason: str

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
    surface = _settle(cells, grid.gsd, options)
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
        surface = _settle(surface.cells.reduced(~outlier), grid.gsd, options, start=surface)
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
    report = GriddingReport(
        offered=offered,
        ignored=offered,
        isolated=0,
        outlying=0,
        emptied=0,
        iterations=0,
        largest_change_m=0.0,
        converged=True,
        reason="no return falls on the grid",
    )
    return Gridding(mapola, report, np.zeros(offered, dtype=np.bool_))


@dataclass(frozen=True, eq=False)
class _Surface:
    """The state at the end of an iteration."""

    cells: CellReturns
    medians: CorrectedMedians
    windows: PlaneWindows
    fitted: FloatArray
    height: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray
    corrected: FloatArray
    iterations: int
    change: float
    converged: bool

    @cached_property
    def planes(self) -> PlaneFit:
        """The planes of the last slopes."""
        return self.windows.fit(self.fitted)

    @cached_property
    def spread(self) -> FloatArray:
        """Robust standard deviation of the returns of each cell, metres; NaN if empty."""
        return self.cells.spreads(self.corrected, self.height)


def _settle(
    cells: CellReturns, gsd: float, options: GriddingOptions, *, start: _Surface | None = None
) -> _Surface:
    """Iterate slopes and medians until no height changes, from the slopes of `start`."""
    place_x, place_y = cells.place
    # Dense cells fit better, but beyond a few returns roughness, not noise, dominates departures
    # from the plane: the weight levels off.
    weight = cells.count / (cells.count + 1.0)
    before = None if start is None else start.medians
    medians = CorrectedMedians(cells, _NEGLECTED * options.tolerance * gsd, before)
    if start is None:
        height = at_place = cells.middle
        slope_x, slope_y = np.zeros_like(height), np.zeros_like(height)
    else:
        slope_x, slope_y = start.slope_x, start.slope_y
        height = medians.at(slope_x, slope_y)
        at_place = height + slope_x * place_x + slope_y * place_y
    windows = PlaneWindows(
        place_x, place_y, weight, baseline=options.baseline, max_radius=options.max_window
    )
    change, iteration = np.inf, 0
    while change > options.tolerance * gsd and iteration < options.max_iterations:
        fitted = at_place
        new_x, new_y = windows.slopes(fitted)
        if iteration >= _FULL_STEPS:
            # A median may alternate between two returns for ever; half steps end that.
            new_x, new_y = 0.5 * (slope_x + new_x), 0.5 * (slope_y + new_y)
        slope_x, slope_y = new_x, new_y
        previous, height = height, medians.at(slope_x, slope_y)
        at_place, change = _carried(height, previous, (slope_x, slope_y), (place_x, place_y))
        iteration += 1
    converged = change <= options.tolerance * gsd
    corrected = medians.of_returns(slope_x, slope_y)
    return _Surface(
        cells,
        medians,
        windows,
        fitted,
        height,
        slope_x,
        slope_y,
        corrected,
        iteration,
        change,
        converged,
    )


@compiled
def _carried(
    height: FloatArray,
    previous: FloatArray,
    slopes: tuple[FloatArray, FloatArray],
    places: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float]:
    """Heights (R, C) moved from the grid points to the places, and the largest change, metres."""
    at_place = np.empty_like(height)
    change = 0.0
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            here = (row, column)
            carried = slopes[0][here] * places[0][here] + slopes[1][here] * places[1][here]
            at_place[here] = height[here] + carried
            moved = abs(height[here] - previous[here])
            change = moved if moved > change else change
    return at_place, change


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
    surface: _Surface,
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
