"""Fusion of one maplet: energy (A) with slopes from images and heights from a lidar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from fusion.fusing.constraints import Constraints
from fusion.fusing.contradiction import contradicted
from fusion.fusing.information import SlopeInformation, along_edges, light_along_edges
from fusion.fusing.maplets.maplet import FusedMaplet, Source
from fusion.fusing.shape import ShapeInformation
from spcola.arrays import BoolArray, FloatArray
from spcola.grids import Maplet, MapletGrid
from spcola.grids.bending import bending
from spcola.grids.gaps import carried_on, filled, plane_of
from spcola.heights import (
    HeightProblem,
    HeightSolution,
    SolverOptions,
    posterior_sigma,
    solve_heights,
)
from spcola.heights.slopes import STEP_SIGMA_FACTOR, slopes_of
from spcola.math.robust import cauchy_weight, mad
from spcola.photometry import SlopeVariance


@dataclass(frozen=True)
class FuseOptions:
    """Options of the fusion.

    Parameters
    ----------
    loss : {"l2", "huber", "cauchy"}
        Loss on the lidar heights; the robust ones limit the influence of outliers.
    loss_scale : float
        In standard deviations: residuals below it have full weight.
    step_loss_scale : float
        In standard deviations: steps of SPC that the lidar contradicts by more are down-weighted
        (Cauchy's loss).
    fraction : float
        Share of the lidar heights that is used (1: all, weighted by their uncertainty).
    seed : int
        Seed of the random subset.
    fill_sigma_m : float
        Sigma, metres, of a height that comes from the shape alone, if it cannot be estimated from
        the lidar.
    tolerance_m : float
        Largest height error of the solver, metres.
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
    """Input of one fused maplet; all layers are on `grid`, heights in metres along Uz.

    Parameters
    ----------
    name : str
    grid : MapletGrid
        In SPC coordinates: the maplet's own, its centre corrected by its match.
    spc : Maplet
        The SPC maplet on that grid.
    lidar : Constraints
    prior : (2q+1, 2q+1) ndarray
        Heights of the shape model; NaN where there is none.
    common_covariance : (3, 3) ndarray
        Of the error that all lidar heights of the maplet share (registration, scans), body-fixed,
        m².
    light : SlopeVariance, optional
        Variance of the slopes from images; `spc` has no heights where images determine no slope.
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
    """The fused maplet and statistics about it.

    Attributes
    ----------
    maplet : FusedMaplet
    solution : HeightSolution
    parts_without_lidar : int
        Number of connected parts without lidar height; SPC or the shape fixes their mean height.
    downweighted : int
        Lidar heights to which the robust loss gave less than half of their weight.
    contradicted : int
        Lone lidar heights left out because they contradict the SPC surface.
    misfit : float
        Robust standard deviation of lidar minus SPC heights about their median, over that of the
        whole solution; NaN if they have no common point.
    """

    maplet: FusedMaplet
    solution: HeightSolution
    parts_without_lidar: int
    downweighted: int
    contradicted: int
    misfit: float


def fuse_maplet(
    parts: FuseInput, information: SlopeInformation, *, options: FuseOptions | None = None
) -> FuseResult:
    """Minimise energy (A) of the derivations for one maplet, with the sigma of each height.

    - Height steps come from the SPC maplet where it has both points, weighted by `information`;
      elsewhere from the shape, with its step error estimated from the lidar.
    - Lidar heights have weight 1/σ² and a robust loss. Lone ones that contradict SPC are left out,
      and the sigma there includes what a boulder of one cell that SPC lacks may be high.
    - Heights of SPC, and of the shape where SPC has none, have small weights: their errors are
      correlated over many points, so the weight of one independent height is divided among these.
      They fix the height of parts without returns.
    - The sigma is that of the inverse normal matrix, but far from the lidar at least SPC's, and far
      from both at least the shape's. The error that all lidar heights share is added, and far
      from them that of the maplet's centre: vertical, and horizontal times the slope.

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
        ``solution.converged`` and its reason state whether the tolerance was reached.
    """
    options = options or FuseOptions()
    generator = np.random.default_rng([options.seed, _name_number(parts.name)])
    doubtful = contradicted(parts.lidar, parts.spc, _spc_sigma(parts, information))
    lidar = parts.lidar.without(doubtful).subset(options.fraction, generator)
    shape = information.shape or _assumed_shape(information, options)
    problem = _problem(parts, lidar, information, shape, options)
    # In effect the loss concerns the lidar only: SPC and shape heights have weights so small that
    # their residuals remain in its quadratic part.
    solution = solve_heights(problem, options=_solver(options))
    own = posterior_sigma(problem, weight=solution.constraint_weight)
    with_lidar = lidar.known
    source = np.select(
        [~problem.mask, parts.spc.valid & with_lidar, with_lidar, parts.spc.valid],
        [Source.NONE, Source.BOTH, Source.LIDAR, Source.IMAGE],
        Source.FILLED,
    )
    sigma = _sigma(parts, lidar, information, shape, solution.height, own)
    sigma = np.hypot(sigma, np.where(doubtful, _doubt(parts), 0.0))
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
        _parts_without_lidar(solution, with_lidar),
        _downweighted(problem, solution, with_lidar),
        int(np.count_nonzero(doubtful)),
        float(mad(parts.lidar.height - parts.spc.height)) / information.height_sigma_m,
    )


def _name_number(name: str) -> int:
    """A number made from a maplet's name, so that each maplet has its own random subset."""
    return int.from_bytes(name.encode("utf-8")[:16].ljust(16, b"\0"), "little")


def _assumed_shape(information: SlopeInformation, options: FuseOptions) -> ShapeInformation:
    """The shape's assumed errors if the lidar cannot determine them: larger than SPC's."""
    return ShapeInformation(
        2.0 * information.step_sigma_m, options.fill_sigma_m, information.correlated_cells
    )


def _shape_surface(parts: FuseInput, lidar: Constraints) -> FloatArray:
    """Heights of the shape with gaps filled; of a plane if there is no shape."""
    if np.isfinite(parts.prior).any():
        return filled(parts.prior)
    return plane_of(np.where(np.isfinite(lidar.height), lidar.height, parts.spc.height))


def _ground(parts: FuseInput, lidar: Constraints, surface: FloatArray) -> FloatArray:
    """Approximate ground, for the weights of steps: lidar, else SPC, else the shape.

    Each is corrected by its nearest difference from the preceding one, so that there is no
    artificial step between them. A plane through the differences would be tilted by noise if the
    lidar is a single track.
    """
    spc = parts.spc.height + np.nan_to_num(carried_on(lidar.height - parts.spc.height))
    known = np.where(np.isfinite(lidar.height), lidar.height, spc)
    if lidar.coarse is not None:
        known = np.where(np.isfinite(known), known, lidar.coarse)
    bent = surface + np.nan_to_num(carried_on(known - surface))
    # An outlier is one cell wide, a boulder is wider: the median removes outliers, which would
    # otherwise reduce the weights of the steps around them.
    return ndimage.median_filter(bent, size=3, mode="nearest")


def _problem(
    parts: FuseInput,
    lidar: Constraints,
    information: SlopeInformation,
    shape: ShapeInformation,
    options: FuseOptions,
) -> HeightProblem:
    """Assemble steps, weights and constraints."""
    valid, gsd = parts.spc.valid, parts.grid.gsd
    mask = valid | lidar.known | np.isfinite(parts.prior)
    known = np.where(valid, parts.spc.height, 0.0)
    surface = _shape_surface(parts, lidar)
    ground = _ground(parts, lidar, surface)
    noise = np.nan_to_num(lidar.sigma)
    bent = np.abs(np.nan_to_num(bending(ground)))
    steps, weights = [], []
    for axis in (1, 0):
        imaged = _both(valid, axis)
        step = np.where(imaged, np.diff(known, axis=axis), np.diff(surface, axis=axis))
        # SPC errors grow with slope, and SPC underestimates steep slopes: the larger of its slope
        # and the lidar's is used.
        ground_step = np.diff(ground, axis=axis)
        slope = np.maximum(np.abs(step), np.abs(ground_step)) / gsd
        bend = along_edges(bent, axis)
        light = None if parts.light is None else light_along_edges(parts.light, 1, axis)
        sigma = information.step_sigma(slope, bend, gsd, light)
        sigma = np.where(imaged, sigma, shape.step_sigma_m)
        # The flank of a boulder that SPC or the shape lacks is an outlier among the errors of
        # steps: with full weight the step would flatten the flank.
        measured = _both(np.isfinite(lidar.height), axis)
        spread = np.hypot(sigma, along_edges(noise, axis))
        contradicted = np.where(imaged | measured, (ground_step - step) / spread, 0.0)
        trust = cauchy_weight(contradicted, options.step_loss_scale)
        # SPC rounds what the lidar resolves.
        trust = np.where(imaged & measured, trust / STEP_SIGMA_FACTOR**2, trust)
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
    """Mask of the edges along `axis` that have both ends in `mask`."""
    count = mask.shape[axis]
    return np.take(mask, range(1, count), axis) & np.take(mask, range(count - 1), axis)


def _heights(
    parts: FuseInput, lidar: Constraints, information: SlopeInformation, shape: ShapeInformation
) -> tuple[FloatArray, FloatArray]:
    """Constraining heights and weights: of the lidar, else of the maplet, else of the shape."""
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, information.height_sigma_m)
    own = np.hypot(own, _center_sigma(parts))
    valid = parts.spc.valid
    height = np.where(valid, parts.spc.height, parts.prior)
    one = shape.height_sigma_m * np.sqrt(shape.correlated_cells)
    sigma = np.where(valid, own * np.sqrt(information.correlated_cells), one)
    with_lidar = np.isfinite(lidar.height)
    height = np.where(with_lidar, lidar.height, height)
    sigma = np.where(with_lidar, lidar.sigma, sigma)
    weight = np.where(np.isfinite(height), 1.0 / np.maximum(sigma, 1e-6) ** 2, 0.0)
    return height, weight


def _spc_sigma(parts: FuseInput, information: SlopeInformation) -> FloatArray:
    """Standard deviation (R, C) of SPC heights relative to the lidar's, metres.

    It includes displacements of the whole surface, and what SPC misses on steep or bent ground.
    """
    height, gsd = parts.spc.height, parts.grid.gsd
    own = np.where(np.isfinite(parts.spc.sigma), parts.spc.sigma, 0.0)
    slope = np.nan_to_num(np.hypot(*slopes_of(height, gsd)))
    bent = np.abs(np.nan_to_num(bending(height)))
    rough = information.step_sigma(slope, bent, gsd)
    center = np.diag(np.nan_to_num(parts.spc.center_sigma) ** 2)
    shared = _displaced_variance(parts.grid, height, center + parts.common_covariance)
    own = np.maximum(own, information.height_sigma_m)
    return np.sqrt(own**2 + rough**2 + shared)


def _doubt(parts: FuseInput) -> FloatArray:
    """Sigma (R, C), metres, that a contradicted lidar height adds: it may be a boulder.

    A boulder that SPC lacks is about one cell wide, and no higher than wide.
    """
    return np.minimum(np.abs(parts.lidar.height - parts.spc.height), parts.grid.gsd)


def _center_sigma(parts: FuseInput) -> float:
    """Sigma of the maplet's centre along Uz, metres; 0 where the file has none."""
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
    """Standard deviation, metres, of the fused heights; `own` is that of the inverse normal matrix.

    `own` is too small far from the lidar: independent step errors correlate heights over more
    points than SPC's errors do, so that many SPC heights seem to average out. There the sigma is at
    least SPC's, its centre included. Near the lidar, it partly determines SPC's errors: with
    an exponential correlation and lidar on both sides, a share tanh(distance / length) remains.
    The same holds for the shape, far from both.
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
    """Share (0 … 1) of an error correlated over `cells` that remains, given `known` points."""
    if not known.any():
        return np.ones(known.shape)
    away = ndimage.distance_transform_edt(~known)
    free: FloatArray = np.tanh(away / np.sqrt(cells / np.pi))
    return free


def _displaced_variance(grid: MapletGrid, height: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance, m², of the height error caused by a displacement of the whole surface.

    A displacement D changes the height at a point by D_z − ∇h · D_xy. The `covariance` of D is
    body-fixed, m².
    """
    slope_x, slope_y = slopes_of(height, grid.gsd)
    rows = np.nan_to_num(np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1))
    local = grid.axes @ covariance @ grid.axes.T
    variance: FloatArray = np.einsum("rci,ij,rcj->rc", rows, local, rows)
    return variance


def _parts_without_lidar(solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of connected parts without a lidar height."""
    labels = solution.components
    everything = set(np.unique(labels[labels >= 0]).tolist())
    return len(everything - set(np.unique(labels[with_lidar]).tolist()))


def _downweighted(problem: HeightProblem, solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of lidar heights whose weight the loss reduced by more than half."""
    halved = solution.constraint_weight < 0.5 * problem.weight
    return int(np.count_nonzero(halved & with_lidar))
