"""Returns to a bigmap: one surface by integration, bridged where returns are missing.

The walk is that of Gaskell et al., eqs. 35, 36 and 22: heights of the cells are constraints of
energy (A), at first with slopes of zero; the surface so integrated has slopes; these correct the
heights of the returns for their places in their cells and are the steps of the next integration;
and so on until nothing changes. Where the surface is known the constraints rule, in so far as
their sigma allows; across a gap the slopes of both sides are carried on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt

from lidar.gridding.cells import CellReturns, CorrectedMedians, sort_into_cells
from lidar.gridding.gridding import GriddingOptions, GriddingReport, grid_returns
from lidar.gridding.mapola import Mapola
from lidar.gridding.point_heights import at_grid_points
from lidar.scans import Returns
from spcola.arrays import (
    AnyArray,
    BoolArray,
    FloatArray,
    frozen,
    read_only,
)
from spcola.errors import SettingsError
from spcola.grids import Maplet, MapletGrid, check_layer
from spcola.heights import (
    STEPS_ALIKE,
    HeightProblem,
    HeightSystem,
    SolverOptions,
    slopes_of,
    steps_from_slopes,
)
from spcola.math.robust import mad

# Noise variance of a step less the mean of the central slopes at its ends, in units of the
# variance of one height: 2 (3/4)² + 2 (1/4)².
_STEP_NOISE = 1.25
# A median is kept where new slopes would move it by less than this share of the tolerance.
_NEGLECTED = 0.05
# Least standard deviation of a step beside that of a height. Steps are read from the surface
# that they then hold, so that stiffer ones would only make the iteration slow.
_STIFFEST = 1.0


@dataclass(frozen=True, eq=False)
class LidarBigmap(Maplet):
    """A bigmap made of lidar returns; unlike a mapola it has heights where no return fell.

    Parameters
    ----------
    count : (2q+1, 2q+1) integer ndarray
        Returns in each cell; 0 where the height bridges a gap.
    spread : (2q+1, 2q+1) array_like
        Robust standard deviation in the cell, metres; NaN with fewer than three returns.
    scan_share : mapping of str to float
        Share of the returns that came from each scan.

    Raises
    ------
    InvalidValueError
        If a layer has another shape.
    """

    count: AnyArray = None  # type: ignore[assignment]  # filled in __post_init__
    spread: FloatArray = None  # type: ignore[assignment]  # filled in __post_init__
    scan_share: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        count = np.zeros(self.grid.shape) if self.count is None else self.count
        count = np.array(count, dtype=np.int32)
        check_layer(count, self.grid, f"{self.name}.count")
        object.__setattr__(self, "count", read_only(count))
        spread = np.full(self.grid.shape, np.nan) if self.spread is None else self.spread
        object.__setattr__(self, "spread", frozen(spread, self.grid.shape, f"{self.name}.spread"))

    @property
    def bridged(self) -> BoolArray:
        """Mask of heights that no return supports."""
        mask: BoolArray = self.valid & (self.count == 0)
        return mask


@dataclass(frozen=True)
class LidarBigmapOptions:
    """How returns become a bigmap.

    Parameters
    ----------
    gridding : GriddingOptions
        Which returns count, and how the cells' first heights and sigmas are found.
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
    """A bigmap of returns and how it came about.

    Attributes
    ----------
    bigmap : LidarBigmap
    returns : GriddingReport
        What happened to the returns.
    step_sigma_m : float
        Standard deviation that a height step about the mean slope of its ends was given,
        metres: the roughness by which gaps grow uncertain.
    rounds : int
        Integrations.
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
    """Integrate `returns` to a bigmap on `grid`; see :func:`integrate_returns`."""
    return integrate_returns(name, grid, returns, options=options).bigmap


def integrate_returns(
    name: str, grid: MapletGrid, returns: Returns, *, options: LidarBigmapOptions | None = None
) -> BigmapGridding:
    """Integrate `returns` to a surface on `grid` ([35, 36], then energy (A), iterated).

    The weights of (A) are inverse variances: of each cell's height (its sigma), and of the
    steps (their robust scatter about the slopes of the gridded heights, freed of noise). Heights
    are those at grid points (:func:`lidar.gridding.at_grid_points`).

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


def bridged_mask(known: BoolArray, max_gap: int) -> BoolArray:
    """Return `known` (R, C) with the gaps that are no wider than `max_gap` cells closed.

    A gap is what a square of max_gap + 1 cells cannot enter (a morphological closing): the
    outline of the known area is not moved outward.
    """
    width = max_gap + 1
    square = np.ones((width, width), dtype=bool)
    padded = np.pad(known, width)
    closed: BoolArray = binary_erosion(binary_dilation(padded, square), square)
    return closed[width:-width, width:-width] | known


def _integrate(
    cells: CellReturns,
    mapola: Mapola,
    bend: FloatArray,
    mask: BoolArray,
    step_sigma: float,
    options: LidarBigmapOptions,
) -> tuple[FloatArray, int, float]:
    """Iterate integrations and slope corrections: heights, rounds, last change (metres).

    `bend` is what has to be added to the mean heights of cells.
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
        # A slope is not known at a point without neighbours; it then corrects nothing.
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
    return float(max(STEPS_ALIKE * rough, _STIFFEST * noise))


def _sigma(mapola: Mapola, mask: BoolArray, step_sigma: float) -> FloatArray:
    """Sigma of the surface: that of the cells, and growing with the distance from them.

    The cells' own sigma is kept although the integration smooths their noise: by how much
    depends on the ground. Across a gap, steps err alike (a slope carried on misses the same bend
    at each step): their error grows with the distance to the nearest known cell, not with its
    root. That a gap has other sides too only makes it better than that.
    """
    if not mapola.valid.any():
        return np.full(mask.shape, np.nan)
    distance, nearest = distance_transform_edt(~mapola.valid, return_indices=True)
    start = mapola.sigma[nearest[0], nearest[1]]
    return np.where(mask, np.hypot(start, distance * step_sigma), np.nan)
