"""One fused maplet: energy (A) with slopes from images and heights from a lidar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from fusion.fused import FusedMaplet, Source
from fusion.fusing.constraints import Constraints
from fusion.fusing.information import (
    SlopeInformation,
    along_edges,
    light_along_edges,
    roughness,
)
from fusion.registration.resolution import filled, plane_of
from spcola.arrays import BoolArray, FloatArray
from spcola.bending import bending
from spcola.gaps import carried_on
from spcola.heights import (
    HeightProblem,
    HeightSolution,
    SolverOptions,
    posterior_sigma,
    slopes_of,
    solve_heights,
)
from spcola.heights.slopes import STEPS_ALIKE
from spcola.maplet import Maplet, MapletGrid
from spcola.photoclinometry import SlopeVariance
from spcola.robust import cauchy_weight


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
        Uncertainty, metres, of a height that comes from the shape alone.
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
    """

    maplet: FusedMaplet
    solution: HeightSolution
    untied: int
    downweighted: int


def fuse_maplet(
    parts: FuseInput, information: SlopeInformation, *, options: FuseOptions | None = None
) -> FuseResult:
    """Minimise (A) of MATH §5 for one maplet and say how sure each height is.

    - Between points that the SPC maplet knows, its height steps enter, weighted by
      `information`; elsewhere the steps of a prior surface (the shape, bent onto the lidar), with
      the roughness that the lidar shows about it.
    - Lidar heights constrain with 1/σ², under a robust loss.
    - SPC heights constrain weakly: their errors hold together over many points, so each of them
      counts as one of that many. This is what ties a part that no return reached.
    - The sigma is that of the inverse normal matrix, but far from the lidar no less than SPC's;
      with what all lidar heights share added, and far from them what the maplet's centre does:
      vertically, and horizontally times the slope.

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
    prior = _prior_surface(parts, lidar)
    problem = _problem(parts, lidar, prior, information, options)
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
    sigma = _sigma(parts, lidar, information, solution.height, own)
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
    )


def _name_number(name: str) -> int:
    """A number that a maplet's name always gives, so that its random subset is its own."""
    return int.from_bytes(name.encode("utf-8")[:16].ljust(16, b"\0"), "little")


def _prior_surface(parts: FuseInput, lidar: Constraints) -> FloatArray:
    """Shape heights bent onto SPC and lidar: what bridges points that neither knows.

    The departure of the known heights (lidar before SPC, which is bent onto the lidar in its turn)
    from the shape is continued into the gaps by its nearest values, so that no step stands at their
    border. Not by a plane through it: along a single track that would be turned by its noise.
    """
    spc = parts.spc.height + np.nan_to_num(carried_on(lidar.height - parts.spc.height))
    known = np.where(np.isfinite(lidar.height), lidar.height, spc)
    if lidar.coarse is not None:
        known = np.where(np.isfinite(known), known, lidar.coarse)
    shape = filled(parts.prior) if np.isfinite(parts.prior).any() else plane_of(known)
    return shape + np.nan_to_num(carried_on(known - shape))


def _problem(
    parts: FuseInput,
    lidar: Constraints,
    prior: FloatArray,
    information: SlopeInformation,
    options: FuseOptions,
) -> HeightProblem:
    """Put steps, weights and constraints together."""
    valid, gsd = parts.spc.valid, parts.grid.gsd
    mask = valid | lidar.known | np.isfinite(parts.prior)
    bridge = _bridge_sigma(lidar, parts, information)
    surface = np.where(valid, parts.spc.height, 0.0)
    # A stray return is one cell wide, a boulder is not: the median keeps the one from
    # loosening the steps around it that are to hold it off.
    ground = ndimage.median_filter(prior, size=3, mode="nearest")
    noise = np.nan_to_num(lidar.sigma)
    bent = np.abs(np.nan_to_num(bending(ground)))
    steps, weights = [], []
    for axis in (1, 0):
        spc_step, prior_step = np.diff(surface, axis=axis), np.diff(prior, axis=axis)
        seen = _both(valid, axis)
        # SPC errs where the ground is steep and its own slope is then too small: the lidar's,
        # which the ground follows, says so too.
        ground_step = np.diff(ground, axis=axis)
        slope = np.maximum(np.abs(spc_step), np.abs(ground_step)) / gsd
        bend = along_edges(bent, axis)
        light = None if parts.light is None else light_along_edges(parts.light, 1, axis)
        sigma = np.where(seen, information.step_sigma(slope, bend, gsd, light), bridge)
        # The flank of a boulder that SPC cut short is no error of the size that steps have: there
        # the step says nothing, and least squares would pull the flank down by it.
        spread = np.hypot(sigma, along_edges(noise, axis))
        contradicted = np.where(seen, (ground_step - spc_step) / spread, 0.0)
        trust = cauchy_weight(np.nan_to_num(contradicted), options.step_loss_scale)
        # SPC rounds what the lidar resolves.
        measured = _both(np.isfinite(lidar.height), axis)
        trust = np.where(measured, trust / STEPS_ALIKE**2, trust)
        steps.append(np.where(seen, spc_step, prior_step))
        weights.append(np.where(_both(mask, axis), trust / sigma**2, 0.0))
    height, weight = _heights(parts, lidar, information, options)
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


def _bridge_sigma(lidar: Constraints, parts: FuseInput, information: SlopeInformation) -> float:
    """Spread, metres, of the steps of the lidar surface about those of the shape (or a plane).

    It is how far a step of the prior surface may be off where nothing better is known: as it is off
    where SPC knows no slopes either, if the lidar has seen enough of that ground.
    """
    known = np.isfinite(parts.prior).any()
    departure = lidar.height - (filled(parts.prior) if known else plane_of(lidar.height))
    step = roughness(np.where(parts.spc.valid, np.nan, departure))
    if not np.isfinite(step):
        step = roughness(departure)
    if not np.isfinite(step):
        return 2.0 * information.step_sigma_m
    return max(step, information.step_sigma_m)


def _heights(
    parts: FuseInput, lidar: Constraints, information: SlopeInformation, options: FuseOptions
) -> tuple[FloatArray, FloatArray]:
    """Constraining heights and weights: the lidar's, else the maplet's own, else the shape's."""
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    own = np.hypot(own, _center_sigma(parts))
    held = parts.spc.valid
    cells = information.correlated_cells
    height = np.where(held, parts.spc.height, parts.prior)
    sigma = np.where(held, own, options.fill_sigma_m) * np.sqrt(cells)
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
    height: FloatArray,
    own: FloatArray,
) -> FloatArray:
    """Standard deviation, metres, of the fused heights, of which the steps and heights say `own`.

    Steps that err independently hold heights together over more points than errors of SPC do, so
    that many weak heights of SPC would seem to average out. Where SPC is alone it is no better than
    it says, its centre included; near the lidar it is by what its errors have in common with those
    there: an exponential correlation, lidar on both sides, leaves a share tanh(distance / length).
    """
    length = np.sqrt(information.correlated_cells / np.pi)
    known = lidar.known
    away = ndimage.distance_transform_edt(~known) if known.any() else np.full(known.shape, np.inf)
    free = np.where(parts.spc.valid, np.tanh(away / length), 0.0)
    spc = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    center = np.diag(np.nan_to_num(parts.spc.center_sigma) ** 2)
    shared = _displaced_variance(parts.grid, height, parts.common_covariance)
    shared = shared + free * _displaced_variance(parts.grid, height, center)
    return np.sqrt(np.maximum(own**2, free * spc**2) + shared)


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
