"""Fusion of one maplet: energy (A) with slopes from images and heights from a lidar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.fusing.contradiction import contradicted
from fusion.fusing.energy import height_problem
from fusion.fusing.fuse_input import FuseInput, FuseOptions
from fusion.fusing.fused_sigma import fused_sigma, missing_boulder_sigma, spc_sigma
from fusion.fusing.maplets import FusedMaplet, Source
from fusion.fusing.uncertainty import ShapeErrors, SlopeInformation
from spcola.arrays import AnyArray, BoolArray
from spcola.heights import (
    HeightProblem,
    HeightSolution,
    SolverOptions,
    posterior_sigma,
    solve_heights,
)
from spcola.math.robust import mad


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
    - The sigma of each height is that of :func:`fusion.fusing.fused_sigma.fused_sigma`.

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
    doubtful = contradicted(parts.lidar, parts.spc, spc_sigma(parts, information))
    lidar = parts.lidar.without(doubtful).subset(options.fraction, generator)
    shape = information.shape or _assumed_shape(information, options)
    problem = height_problem(parts, lidar, information, shape, options)
    solver = SolverOptions(
        tolerance_m=options.tolerance_m, loss=options.loss, loss_scale=options.loss_scale
    )
    # In effect the loss concerns the lidar only: SPC and shape heights have weights so small that
    # their residuals remain in its quadratic part.
    solution = solve_heights(problem, options=solver)
    own = posterior_sigma(problem, weight=solution.constraint_weight)
    with_lidar = lidar.known
    sigma = fused_sigma(parts, lidar, information, shape, solution.height, own)
    sigma = np.hypot(sigma, np.where(doubtful, missing_boulder_sigma(parts), 0.0))
    maplet = FusedMaplet(
        name=parts.name,
        grid=parts.grid,
        height=np.where(problem.mask, solution.height, np.nan),
        albedo=parts.spc.albedo,
        sigma=np.where(problem.mask, sigma, np.nan),
        count=np.where(problem.mask, lidar.count, 0),
        source=_sources(problem.mask, parts.spc.valid, with_lidar),
    )
    return FuseResult(
        maplet,
        solution,
        _parts_without_lidar(solution, with_lidar),
        _downweighted(problem, solution, with_lidar),
        int(np.count_nonzero(doubtful)),
        float(mad(parts.lidar.height - parts.spc.height)) / information.height_sigma_m,
    )


def _sources(mask: BoolArray, by_images: BoolArray, with_lidar: BoolArray) -> AnyArray:
    """Return the code of the source of each height."""
    cases = [~mask, by_images & with_lidar, with_lidar, by_images]
    codes = [Source.NONE, Source.BOTH, Source.LIDAR, Source.IMAGE]
    return np.select(cases, codes, Source.FILLED).astype(np.uint8)


def _name_number(name: str) -> int:
    """A number made from a maplet's name, so that each maplet has its own random subset."""
    return int.from_bytes(name.encode("utf-8")[:16].ljust(16, b"\0"), "little")


def _assumed_shape(information: SlopeInformation, options: FuseOptions) -> ShapeErrors:
    """The shape's assumed errors if the lidar cannot determine them: larger than SPC's."""
    return ShapeErrors(
        2.0 * information.step_sigma_m, options.fill_sigma_m, information.correlated_cells
    )


def _parts_without_lidar(solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of connected parts without a lidar height."""
    labels = solution.components
    everything = set(np.unique(labels[labels >= 0]).tolist())
    return len(everything - set(np.unique(labels[with_lidar]).tolist()))


def _downweighted(problem: HeightProblem, solution: HeightSolution, with_lidar: BoolArray) -> int:
    """Number of lidar heights whose weight the loss reduced by more than half."""
    halved = solution.constraint_weight < 0.5 * problem.weight
    return int(np.count_nonzero(halved & with_lidar))
