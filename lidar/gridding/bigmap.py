"""Returns to a bigmap: one surface by integration, which bridges gaps without returns.

The iteration is that of Gaskell et al., eqs. 35, 36 and 22: heights of the cells are constraints of
energy (A), at first with slopes of zero; the integrated surface has slopes; these correct the
heights of the returns for their places in their cells and are the steps of the next integration;
and so on until nothing changes. Where there are returns the constraints dominate, as far as their
sigma allows; across a gap the slopes of both sides are extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import distance_transform_edt

from lidar.gridding.cells.cells import CellReturns, CorrectedMedians, sort_into_cells
from lidar.gridding.gridding import GriddingReport, grid_returns
from lidar.gridding.mapola import LidarBigmap, Mapola
from lidar.gridding.options import GriddingOptions
from lidar.gridding.point_heights import at_grid_points
from lidar.scans import Returns
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError
from spcola.grids import MapletGrid
from spcola.grids.gaps import bridged_mask
from spcola.heights import HeightProblem, HeightSystem, SolverOptions
from spcola.heights.slopes import STEP_SIGMA_FACTOR, slopes_of, steps_from_slopes
from spcola.math.robust import mad

# Noise variance of a step less the mean of the central slopes at its ends, in units of the
# variance of one height: 2 (3/4)² + 2 (1/4)².
_STEP_NOISE = 1.25
# A median is unchanged where new slopes would move it by less than this share of the tolerance.
_NEGLECTED = 0.05
# Least standard deviation of a step, relative to that of a height. Steps are read from the surface
# that they then constrain: stiffer ones would only slow the iteration down.
_STIFFEST = 1.0


@dataclass(frozen=True)
class LidarBigmapOptions:
    """Settings of the integration of returns to a bigmap.

    Parameters
    ----------
    gridding : GriddingOptions
        Rejection of returns, and first heights and sigmas of the cells.
    max_gap : int
        Widest gap that is bridged, in cells; 0: none. Nothing is added outside of the returns.
    tolerance : float
        The iteration ends when no height changes by more than this, in GSD.
    max_rounds : int
        Most integrations.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    gridding: GriddingOptions = field(default_factory=GriddingOptions)
    max_gap: int = 4
    tolerance: float = 1e-4
    max_rounds: int = 200

    def __post_init__(self) -> None:
        if self.max_gap < 0:
            raise SettingsError(f"must not be negative, but is {self.max_gap}", "max_gap")
        for name in ("tolerance", "max_rounds"):
            if not getattr(self, name) > 0:
                raise SettingsError(f"must be positive, not {getattr(self, name)}", name)


@dataclass(frozen=True, eq=False)
class BigmapGridding:
    """A bigmap of returns and the state of its integration.

    Attributes
    ----------
    bigmap : LidarBigmap
    returns : GriddingReport
        Counts of used and rejected returns.
    step_sigma_m : float
        Standard deviation assumed for a height step about the mean slope of its ends, metres:
        the roughness by which uncertainty grows in gaps.
    rounds : int
        Number of integrations.
    largest_change_m : float
        Largest change of a height in the last round, metres.
    converged : bool
    reason : str
        Why the iteration stopped.
    """

    bigmap: LidarBigmap
    returns: GriddingReport
    step_sigma_m: float
    rounds: int
    largest_change_m: float
    converged: bool
    reason: str


def bigmap_from_returns(
    name: str, grid: MapletGrid, returns: Returns, *, options: LidarBigmapOptions | None = None
) -> LidarBigmap:
    """Return the bigmap `name` on `grid` of :func:`integrate_returns` with `returns`, `options`."""
    return integrate_returns(name, grid, returns, options=options).bigmap


def integrate_returns(
    name: str, grid: MapletGrid, returns: Returns, *, options: LidarBigmapOptions | None = None
) -> BigmapGridding:
    """Integrate `returns` to a surface on `grid` ([35, 36], then energy (A), iterated).

    The weights of (A) are inverse variances: of each cell's height (its sigma), and of the steps
    (their robust scatter about the slopes of the gridded heights, less noise). Heights are those
    at grid points (:func:`lidar.gridding.at_grid_points`).

    Returns
    -------
    BigmapGridding
        A bigmap without heights if no return falls on the grid.
    """
    options = options or LidarBigmapOptions()
    gridding = grid_returns(name, grid, returns, options=options.gridding)
    mapola = at_grid_points(gridding.mapola)
    cells = sort_into_cells(grid, returns.points[gridding.used], options.gridding.reach(grid))
    mask = bridged_mask(mapola.valid, options.max_gap)
    step_sigma = _step_sigma(mapola)
    bend = mapola.height - gridding.mapola.height
    height, rounds, change = _integrate(cells, mapola, bend, mask, step_sigma, options)
    converged = change <= options.tolerance * grid.gsd
    limit = f"the limit of {options.max_rounds} integrations was reached"
    bigmap = LidarBigmap(
        name,
        grid,
        height,
        sigma=_sigma(mapola, mask, step_sigma),
        count=mapola.count,
        spread=mapola.spread,
        scan_share=mapola.scan_share,
    )
    return BigmapGridding(
        bigmap,
        gridding.report,
        step_sigma,
        rounds,
        change,
        converged,
        "no height changes any more" if converged else limit,
    )


def _integrate(
    cells: CellReturns,
    mapola: Mapola,
    bend: FloatArray,
    mask: BoolArray,
    step_sigma: float,
    options: LidarBigmapOptions,
) -> tuple[FloatArray, int, float]:
    """Iterate integrations and slope corrections: heights, rounds, last change (metres).

    `bend` is added to the mean heights of cells.
    """
    gsd = mapola.grid.gsd
    with np.errstate(divide="ignore"):
        weight = np.where(mapola.valid, 1.0 / mapola.sigma**2, 0.0)
    edge_weight = 1.0 / step_sigma**2 if step_sigma > 0 else 1.0
    solver = SolverOptions(tolerance_m=0.05 * options.tolerance * gsd)
    constraint, surface = mapola.height, np.where(mask, mapola.height, np.nan)
    slope_x, slope_y = np.zeros(mask.shape), np.zeros(mask.shape)
    medians = CorrectedMedians(cells, _NEGLECTED * options.tolerance * gsd)
    change, rounds = np.inf, 0
    step_x, step_y = steps_from_slopes(slope_x, slope_y, gsd)
    weights = (np.full(step_x.shape, edge_weight), np.full(step_y.shape, edge_weight))
    problem = HeightProblem(step_x, step_y, *weights, constraint, weight, mask)
    system = HeightSystem(problem)
    while change > options.tolerance * gsd and rounds < options.max_rounds:
        step_x, step_y = steps_from_slopes(slope_x, slope_y, gsd)
        problem = problem.with_data(step_x=step_x, step_y=step_y, height=constraint)
        found = system.solve(problem, options=solver, start=surface)
        previous, surface = surface, found.height
        # The slope of a point without neighbours is unknown; it then corrects nothing.
        steep_x, steep_y = slopes_of(surface, gsd)
        slope_x, slope_y = np.nan_to_num(steep_x), np.nan_to_num(steep_y)
        constraint = medians.at(slope_x * gsd, slope_y * gsd) + bend
        new = np.isnan(previous) & mask
        change = np.inf if new.any() else float(np.nanmax(np.abs(surface - previous), initial=0.0))
        rounds += 1
    return surface, rounds, change


def _step_sigma(mapola: Mapola) -> float:
    """Return the standard deviation of steps about the slopes, metres, without the noise."""
    step_x, step_y = steps_from_slopes(*slopes_of(mapola.height, mapola.grid.gsd), mapola.grid.gsd)
    departure = np.concatenate(
        [
            (np.diff(mapola.height, axis=1) - step_x).ravel(),
            (np.diff(mapola.height, axis=0) - step_y).ravel(),
        ]
    )
    known = mapola.sigma[mapola.valid]
    noise = float(np.median(known)) if known.size else mapola.grid.gsd
    seen = float(np.nan_to_num(mad(departure)))
    rough = np.sqrt(max(seen**2 - _STEP_NOISE * noise**2, 0.0))
    return float(max(STEP_SIGMA_FACTOR * rough, _STIFFEST * noise))


def _sigma(mapola: Mapola, mask: BoolArray, step_sigma: float) -> FloatArray:
    """Sigma of the surface: that of the cells, increasing with the distance from them.

    The cells' own sigma is kept although the integration smooths their noise: by how much depends
    on the ground. Across a gap, errors of steps are correlated (an extrapolated slope misses the
    same bend at each step): their sum grows with the distance to the nearest known cell, not with
    its root. Other sides of the gap only reduce it.
    """
    if not mapola.valid.any():
        return np.full(mask.shape, np.nan)
    distance, nearest = distance_transform_edt(~mapola.valid, return_indices=True)
    start = mapola.sigma[nearest[0], nearest[1]]
    return np.where(mask, np.hypot(start, distance * step_sigma), np.nan)
