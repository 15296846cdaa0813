"""One fused maplet: energy (A) with slopes from images and heights from a lidar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from fusion.fusing.constraints import Constraints
from fusion.fusing.information import SlopeInformation, along_edges, light_along_edges
from fusion.fusing.maplets.maplet import FusedMaplet, Source
from fusion.fusing.shape import ShapeInformation
from fusion.surfacematch.resolution import filled, plane_of
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import Maplet, MapletGrid, carried_on
from spcola.grids.statistics import bending
from spcola.heights import (
    STEPS_ALIKE,
    HeightProblem,
    HeightSolution,
    SolverOptions,
    posterior_sigma,
    slopes_of,
    solve_heights,
)
from spcola.math.robust import cauchy_weight, mad
from spcola.photometry import SlopeVariance


@dataclass(frozen=True)
class FuseOptions:
    """How heights are fused.

    Parameters
    ----------
    loss : {"l2", "huber", "cauchy"}
        Loss on the lidar heights; the robust ones keep stray returns from pulling.
    loss_scale : float
        In standard deviations: residuals below it count in full.
    step_loss_scale : float
        In standard deviations: steps of SPC that the lidar contradicts by more than that lose
        weight (Cauchy's loss).
    fraction : float
        Share of the lidar heights that constrain (1: all, weighted by their uncertainty).
    seed : int
        Of the random subset.
    fill_sigma_m : float
        Uncertainty, metres, of a height that comes from the shape alone, where no lidar height
        could tell.
    tolerance_m : float
        Largest height error that the solver may leave, metres.
    """

    loss: Literal["l2", "huber", "cauchy"] = "huber"
    loss_scale: float = 2.0
    step_loss_scale: float = 1.0
    fraction: float = 1.0
    seed: int = 0
    fill_sigma_m: float = 1.0
    tolerance_m: float = 1e-5


@dataclass(frozen=True, eq=False)
class FuseInput:
    """What goes into one fused maplet; all layers are on `grid`, heights in metres along Uz.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        In SPC coordinates; the maplet's own, moved by what the match says of its centre.
    spc : Maplet
        The SPC maplet on that grid.
    lidar : Constraints
    prior : (2q+1, 2q+1) ndarray
        Heights of the shape model; NaN where there is none.
    common_covariance : (3, 3) ndarray
        Of what all lidar heights of the maplet share (registration, scans), body-fixed, m².
    light : SlopeVariance, optional
        What images tell of the slopes there; where they tell nothing, `spc` has no heights.
    """

    name: str
    grid: MapletGrid
    spc: Maplet
    lidar: Constraints
    prior: FloatArray
    common_covariance: FloatArray
    light: SlopeVariance | None = None


@dataclass(frozen=True, eq=False)
class FuseResult:
    """The fused maplet and what is to be told of it.

    Attributes
    ----------
    maplet : FusedMaplet
    solution : HeightSolution
    untied : int
        Connected parts that no lidar height ties, so that the SPC maplet or the shape does.
    downweighted : int
        Lidar heights to which the robust loss gave less than half of their weight.
    misfit : float
        Robust standard deviation of lidar less SPC heights, less a constant, over what it is in the
        whole solution; NaN where they do not meet.
    """

    maplet: FusedMaplet
    solution: HeightSolution
    untied: int
    downweighted: int
    misfit: float


def fuse_maplet(
    parts: FuseInput, information: SlopeInformation, *, options: FuseOptions | None = None
) -> FuseResult:
    """Minimise (A) of MATH §5 for one maplet and say how sure each height is.

    - Between points that the SPC maplet knows, its height steps enter, weighted by
      `information`; elsewhere the steps of the shape do, with the roughness that the lidar shows
      about it.
    - Lidar heights constrain with 1/σ², under a robust loss.
    - Heights of SPC, and of the shape where SPC has none, constrain weakly: their errors hold
      together over many points, so each of them counts as one of that many. This is what ties a
      part that no return reached.
    - The sigma is that of the inverse normal matrix, but far from the lidar no less than SPC's,
      and far from both no less than the shape's; with what all lidar heights share added, and far
      from them what the maplet's centre does: vertically, and horizontally times the slope.

    Parameters
    ----------
    parts : FuseInput
        SPC maplet, lidar heights and shape on one grid, SPC coordinates, metres.
    information : SlopeInformation
        Of the whole solution.
    options : FuseOptions, optional

    Returns
    -------
    FuseResult
        ``solution.converged`` and its reason say whether the tolerance was reached.
    """
    options = options or FuseOptions()
    generator = np.random.default_rng([options.seed, _name_number(parts.name)])
    lidar = parts.lidar.subset(options.fraction, generator)
    shape = information.shape or _assumed_shape(information, options)
    problem = _problem(parts, lidar, information, shape, options)
    # The loss is for the lidar alone; the weak SPC and shape heights stay quadratic because
    # their weights keep them far below its scale.
    solution = solve_heights(problem, options=_solver(options))
    own = posterior_sigma(problem, weight=solution.constraint_weight)
    with_lidar = lidar.known
    source = np.select(
        [~problem.mask, parts.spc.valid & with_lidar, with_lidar, parts.spc.valid],
        [Source.NONE, Source.BOTH, Source.LIDAR, Source.IMAGE],
        Source.FILLED,
    )
    sigma = _sigma(parts, lidar, information, shape, solution.height, own)
    maplet = FusedMaplet(
        name=parts.name,
        grid=parts.grid,
        height=np.where(problem.mask, solution.height, np.nan),
        albedo=parts.spc.albedo,
        sigma=np.where(problem.mask, sigma, np.nan),
        count=np.where(problem.mask, lidar.count, 0),
        source=source.astype(np.uint8),
    )
    return FuseResult(
        maplet,
        solution,
        _untied(solution, with_lidar),
        _downweighted(problem, solution, with_lidar),
        float(mad(parts.lidar.height - parts.spc.height)) / information.height_sigma_m,
    )


def _name_number(name: str) -> int:
    """A number that a maplet's name always gives, so that its random subset is its own."""
    return int.from_bytes(name.encode("utf-8")[:16].ljust(16, b"\0"), "little")


def _assumed_shape(information: SlopeInformation, options: FuseOptions) -> ShapeInformation:
    """What a shape is taken to know where no lidar height could tell: less than SPC."""
    return ShapeInformation(
        2.0 * information.step_sigma_m, options.fill_sigma_m, information.correlated_cells
    )


def _shape_surface(parts: FuseInput, lidar: Constraints) -> FloatArray:
    """The shape, its gaps closed; without one a plane."""
    if np.isfinite(parts.prior).any():
        return filled(parts.prior)
    return plane_of(np.where(np.isfinite(lidar.height), lidar.height, parts.spc.height))


def _ground(parts: FuseInput, lidar: Constraints, surface: FloatArray) -> FloatArray:
    """What the ground is like, for the weights of steps: lidar, else SPC, else the shape.

    Each bent onto the one before by the nearest departure, so that no step stands between them that
    the ground does not have. Not by a plane through it: along a single track that would be turned
    by its noise.
    """
    spc = parts.spc.height + np.nan_to_num(carried_on(lidar.height - parts.spc.height))
    known = np.where(np.isfinite(lidar.height), lidar.height, spc)
    if lidar.coarse is not None:
        known = np.where(np.isfinite(known), known, lidar.coarse)
    bent = surface + np.nan_to_num(carried_on(known - surface))
    # A stray return is one cell wide, a boulder is not: the median keeps the one from
    # loosening the steps around it that are to hold it off.
    return ndimage.median_filter(bent, size=3, mode="nearest")


def _problem(
    parts: FuseInput,
    lidar: Constraints,
    information: SlopeInformation,
    shape: ShapeInformation,
    options: FuseOptions,
) -> HeightProblem:
    """Put steps, weights and constraints together."""
    valid, gsd = parts.spc.valid, parts.grid.gsd
    mask = valid | lidar.known | np.isfinite(parts.prior)
    known = np.where(valid, parts.spc.height, 0.0)
    surface = _shape_surface(parts, lidar)
    ground = _ground(parts, lidar, surface)
    noise = np.nan_to_num(lidar.sigma)
    bent = np.abs(np.nan_to_num(bending(ground)))
    steps, weights = [], []
    for axis in (1, 0):
        seen = _both(valid, axis)
        step = np.where(seen, np.diff(known, axis=axis), np.diff(surface, axis=axis))
        # SPC errs where the ground is steep and its own slope is then too small: the lidar's,
        # which the ground follows, says so too.
        ground_step = np.diff(ground, axis=axis)
        slope = np.maximum(np.abs(step), np.abs(ground_step)) / gsd
        bend = along_edges(bent, axis)
        light = None if parts.light is None else light_along_edges(parts.light, 1, axis)
        sigma = information.step_sigma(slope, bend, gsd, light)
        sigma = np.where(seen, sigma, shape.step_sigma_m)
        # The flank of a boulder that SPC cut short, or that the shape does not know, is no error
        # of the size that steps have: there the step says nothing, and least squares would pull
        # the flank down by it.
        measured = _both(np.isfinite(lidar.height), axis)
        spread = np.hypot(sigma, along_edges(noise, axis))
        contradicted = np.where(seen | measured, (ground_step - step) / spread, 0.0)
        trust = cauchy_weight(contradicted, options.step_loss_scale)
        # SPC rounds what the lidar resolves.
        trust = np.where(seen & measured, trust / STEPS_ALIKE**2, trust)
        steps.append(step)
        weights.append(np.where(_both(mask, axis), trust / sigma**2, 0.0))
    height, weight = _heights(parts, lidar, information, shape)
    return HeightProblem(
        steps[0], steps[1], weights[0], weights[1], height, weight, mask, lidar.means
    )


def _solver(options: FuseOptions) -> SolverOptions:
    return SolverOptions(
        tolerance_m=options.tolerance_m, loss=options.loss, loss_scale=options.loss_scale
    )


def _both(mask: BoolArray, axis: int) -> BoolArray:
    """Edges (along `axis`) both ends of which are in `mask`."""
    count = mask.shape[axis]
    return np.take(mask, range(1, count), axis) & np.take(mask, range(count - 1), axis)


def _heights(
    parts: FuseInput, lidar: Constraints, information: SlopeInformation, shape: ShapeInformation
) -> tuple[FloatArray, FloatArray]:
    """Constraining heights and weights: the lidar's, else the maplet's own, else the shape's."""
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    own = np.hypot(own, _center_sigma(parts))
    held = parts.spc.valid
    height = np.where(held, parts.spc.height, parts.prior)
    one = shape.height_sigma_m * np.sqrt(shape.correlated_cells)
    sigma = np.where(held, own * np.sqrt(information.correlated_cells), one)
    with_lidar = np.isfinite(lidar.height)
    height = np.where(with_lidar, lidar.height, height)
    sigma = np.where(with_lidar, lidar.sigma, sigma)
    weight = np.where(np.isfinite(height), 1.0 / np.maximum(sigma, 1e-6) ** 2, 0.0)
    return height, weight


def _center_sigma(parts: FuseInput) -> float:
    """Uncertainty of the maplet's centre along Uz, metres; 0 where the file does not say."""
    along = parts.grid.uz**2 @ np.nan_to_num(parts.spc.center_sigma) ** 2
    return float(np.sqrt(along))


def _sigma(
    parts: FuseInput,
    lidar: Constraints,
    information: SlopeInformation,
    shape: ShapeInformation,
    height: FloatArray,
    own: FloatArray,
) -> FloatArray:
    """Standard deviation, metres, of the fused heights, of which the steps and heights say `own`.

    Steps that err independently hold heights together over more points than errors of SPC do, so
    that many weak heights of SPC would seem to average out. Where SPC is alone it is no better than
    it says, its centre included; near the lidar it is by what its errors have in common with those
    there: an exponential correlation, lidar on both sides, leaves a share tanh(distance / length).
    So it is with the shape, away from what either knows.
    """
    valid = parts.spc.valid
    free = np.where(valid, _free(lidar.known, information.correlated_cells), 0.0)
    spc = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    filled_in = _free(lidar.known | valid, shape.correlated_cells)
    least = np.maximum(free * spc**2, filled_in * shape.height_sigma_m**2)
    center = np.diag(np.nan_to_num(parts.spc.center_sigma) ** 2)
    shared = _displaced_variance(parts.grid, height, parts.common_covariance)
    shared = shared + free * _displaced_variance(parts.grid, height, center)
    return np.sqrt(np.maximum(own**2, least) + shared)


def _free(known: BoolArray, cells: float) -> FloatArray:
    """Share of an error over `cells` points that what is `known` around leaves, 0 … 1."""
    if not known.any():
        return np.ones(known.shape)
    away = ndimage.distance_transform_edt(~known)
    free: FloatArray = np.tanh(away / np.sqrt(cells / np.pi))
    return free


def _displaced_variance(grid: MapletGrid, height: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance, m², of the height error that a displacement of the whole surface makes.

    A surface displaced by D is met at a height that is off by D_z − ∇h · D_xy. The `covariance`
    of D is body-fixed, m².
    """
    slope_x, slope_y = slopes_of(height, grid.gsd)
    rows = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    local = grid.axes @ covariance @ grid.axes.T
    variance: FloatArray = np.einsum("rci,ij,rcj->rc", rows, local, rows)
    return variance


def _untied(solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of connected parts in which no lidar height lies."""
    labels = solution.components
    everything = set(np.unique(labels[labels >= 0]).tolist())
    return len(everything - set(np.unique(labels[with_lidar]).tolist()))


def _downweighted(problem: HeightProblem, solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of lidar heights that the loss left with less than half of their weight."""
    halved = solution.constraint_weight < 0.5 * problem.weight
    return int(np.count_nonzero(halved & with_lidar))
