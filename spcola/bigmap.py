"""Bigmaps: one surface from all the maplets that overlap it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import AnyArray, FloatArray, check_shape, read_only
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import Maplet, MapletGrid, ProjectedMaplet, project_window
from spcola.heights import HeightProblem, SolverOptions, solve_heights
from spcola.heights.slopes import steps_from_slopes


@dataclass(frozen=True, eq=False)
class Bigmap(Maplet):
    """A :class:`~spcola.grids.Maplet` made of several; its sigma includes their disagreement.

    Parameters
    ----------
    count : (2q+1, 2q+1) integer ndarray
        Number of maplets that gave each point a height.

    Raises
    ------
    InvalidValueError
        If a layer has another shape, or a point with a height has no maplet.
    """

    count: AnyArray = None  # type: ignore[assignment]  # refused if missing

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count is None:
            raise InvalidValueError("a bigmap needs the count of maplets", self.name)
        count = np.array(self.count, dtype=np.int32)
        check_shape(count, self.grid.shape, f"{self.name}.count")
        if (count[self.valid] < 1).any():
            raise InvalidValueError("has a height where no maplet reaches", self.name)
        object.__setattr__(self, "count", read_only(count))


@dataclass(frozen=True)
class BigmapOptions:
    """Settings of :func:`make_bigmap`.

    Parameters
    ----------
    max_gsd : float, optional
        Coarsest maplet that is used, metres.
    max_distance : float, optional
        Farthest height from the reference surface that is used, metres.
    integrate : bool
        Whether the averaged slopes are integrated; otherwise the averaged heights are kept.
    constraint_fraction : float
        Share of the averaged heights that constrain the integration, 0 … 1; 1 takes all.
    constraint_weight : float
        Weight of one constraint relative to that of a step between neighbours (Gaskell et al.,
        eq. 23). The surface follows the averaged heights over lengths above
        1 / √(fraction × weight) steps, and the averaged slopes below.
    seed : int
        Seed of the generator that chooses the constraints.
    tolerance_m : float, optional
        Tolerance of the integration; 1e-6 of the bigmap's GSD if not given.

    Raises
    ------
    SettingsError
        If a value lies outside its range.
    """

    max_gsd: float | None = None
    max_distance: float | None = None
    integrate: bool = True
    constraint_fraction: float = 0.02
    constraint_weight: float = 0.02
    seed: int = 0
    tolerance_m: float | None = None

    def __post_init__(self) -> None:
        for name in ("max_gsd", "max_distance", "constraint_weight", "tolerance_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise SettingsError(f"must be positive, not {value}", name)
        if not 0 < self.constraint_fraction <= 1:
            raise SettingsError(
                f"must be in (0, 1], not {self.constraint_fraction}", "constraint_fraction"
            )


def make_bigmap(
    name: str,
    grid: MapletGrid,
    maplets: Iterable[Maplet],
    *,
    options: BigmapOptions | None = None,
    reference: FloatArray | None = None,
) -> Bigmap:
    """Build a bigmap from all `maplets` that overlap `grid` (Gaskell et al. §5.1).

    Every maplet is projected into the bigmap's frame; heights, slopes and albedo are averaged
    with the weight s0² / (s0² + s1²), s0 the GSD of the bigmap and s1 that of the maplet; the
    averaged slopes are integrated with a few (or all) averaged heights as constraints. Slopes do
    not depend on a height offset of a maplet, so that no step remains at its edge.

    Parameters
    ----------
    name : str
        Name of the bigmap.
    grid : MapletGrid
        Its position.
    maplets : iterable of Maplet
        Used one after the other, so that they need not all be in memory.
    options : BigmapOptions, optional
        Limits and constraints.
    reference : (2q+1, 2q+1) ndarray, optional
        Heights of the surface from which `max_distance` is counted, metres, NaN where there is
        none; the reference plane of `grid` if not given.

    Returns
    -------
    Bigmap
        Sigma is the weighted standard deviation of the heights at a point, or the weighted rms
        of the stated sigmas of the maplets there if that is larger: two heights may agree by
        chance, and maplets with shared errors always agree. NaN where there is only one maplet
        without a stated sigma.

    Raises
    ------
    InvalidValueError
        If `reference` has another shape.
    """
    chosen = BigmapOptions() if options is None else options
    average = _Average(grid, chosen.max_distance, reference)
    for maplet in maplets:
        if _may_reach(maplet, grid, chosen):
            average.add(project_window(maplet, grid), maplet.grid.gsd)
    height = average.height
    if chosen.integrate and average.count.any():
        height = _integrate(average, grid.gsd, chosen)
    return Bigmap(name, grid, height, average.albedo, average.sigma, count=average.count)


class _Average:
    """Running weighted means over maplets (West's update: no cancellation in the spread)."""

    def __init__(
        self, grid: MapletGrid, max_distance: float | None, reference: FloatArray | None
    ) -> None:
        if reference is not None:
            check_shape(reference, grid.shape, "reference")
        self._gsd = grid.gsd
        self._max_distance = max_distance
        self._reference = reference
        self.count = np.zeros(grid.shape, dtype=np.int32)
        self._weight, self._weight2, self._scatter = (np.zeros(grid.shape) for _ in range(3))
        self._stated_weight, self._stated = np.zeros(grid.shape), np.zeros(grid.shape)
        # Height, two slopes, albedo.
        self._mean = np.zeros((4, *grid.shape))

    def add(self, part: ProjectedMaplet, gsd: float) -> None:
        """Add one projected maplet of the given GSD (metres)."""
        window = (part.rows, part.columns)
        use = part.valid
        if self._max_distance is not None:
            zero = 0.0 if self._reference is None else self._reference[window]
            # A missing reference is no reason to drop a height: NaN compares as False.
            use &= ~(np.abs(part.height - zero) > self._max_distance)
        weight = self._gsd**2 / (self._gsd**2 + gsd**2) * use
        total = self._weight[window]
        total += weight
        self._weight2[window] += weight * weight
        self.count[window] += use
        share = np.divide(weight, total, out=np.zeros(weight.shape), where=use)
        layers = (part.height, part.slope_x, part.slope_y, part.albedo)
        for k, layer in enumerate(layers):
            mean = self._mean[k][window]
            apart = np.where(use, layer - mean, 0.0)
            mean += share * apart
            if k == 0:
                self._scatter[window] += weight * (1.0 - share) * apart * apart
        stated = use & np.isfinite(part.sigma)
        self._stated_weight[window] += weight * stated
        self._stated[window] += weight * np.where(stated, part.sigma, 0.0) ** 2

    @property
    def height(self) -> FloatArray:
        """Weighted mean height, metres; NaN where no maplet reaches."""
        return np.where(self.count > 0, self._mean[0], np.nan)

    @property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Weighted mean slopes ∂h/∂x, ∂h/∂y; NaN where no maplet reaches."""
        known = self.count > 0
        return np.where(known, self._mean[1], np.nan), np.where(known, self._mean[2], np.nan)

    @property
    def albedo(self) -> FloatArray:
        """Weighted mean albedo; NaN where no maplet reaches."""
        return np.where(self.count > 0, self._mean[3], np.nan)

    @property
    def sigma(self) -> FloatArray:
        """Weighted standard deviation (unbiased) or rms stated sigma, the larger, metres."""
        several = self.count > 1
        freedom = self._weight - np.divide(
            self._weight2, self._weight, out=np.zeros(several.shape), where=several
        )
        unknown = np.full(several.shape, np.nan)
        scatter = np.divide(self._scatter, freedom, out=unknown.copy(), where=several)
        some = self._stated_weight > 0
        stated = np.divide(self._stated, self._stated_weight, out=unknown, where=some)
        return np.sqrt(np.fmax(scatter, stated))


def _may_reach(maplet: Maplet, grid: MapletGrid, options: BigmapOptions) -> bool:
    """Whether the maplet is fine enough and could lie above the grid."""
    if options.max_gsd is not None and maplet.grid.gsd > options.max_gsd:
        return False
    if not maplet.valid.any():
        return False
    x, y, _ = grid.project(maplet.grid.center)
    relief = float(np.nanmax(np.abs(maplet.height)))
    reach = grid.half_size + np.hypot(maplet.grid.radius, relief) / grid.gsd
    return bool(abs(x) <= reach and abs(y) <= reach)


def _integrate(average: _Average, gsd: float, options: BigmapOptions) -> FloatArray:
    """Integrate the averaged slopes, constrained by averaged heights (energy (A))."""
    height = average.height
    step_x, step_y = steps_from_slopes(*average.slopes, gsd)
    problem = HeightProblem(
        step_x,
        step_y,
        np.isfinite(step_x).astype(np.float64),
        np.isfinite(step_y).astype(np.float64),
        height,
        _constraint_weights(average, options),
        np.isfinite(height),
    )
    tolerance = 1e-6 * gsd if options.tolerance_m is None else options.tolerance_m
    # A part without a constraint keeps the mean of its averaged heights.
    solution = solve_heights(
        problem, options=SolverOptions(tolerance_m=tolerance, floating="start"), start=height
    )
    return solution.height


def _constraint_weights(average: _Average, options: BigmapOptions) -> FloatArray:
    """Weights of the averaged heights: a seeded subset of equal ones, or all by their sigma."""
    reached = average.count > 0
    weight = np.where(reached, options.constraint_weight, 0.0)
    if options.constraint_fraction < 1:
        rng = np.random.default_rng(options.seed)
        weight[rng.random(reached.shape) >= options.constraint_fraction] = 0.0
        return weight
    variance = average.sigma**2
    known = np.isfinite(variance)
    if not known.any():
        return weight
    typical = float(np.median(variance[known]))
    # The standard deviation of two or three heights may be tiny by chance, so that the typical
    # variance is added: no weight exceeds twice the typical one.
    if typical > 0:
        weight[known] *= 2 * typical / (typical + variance[known])
    return weight
