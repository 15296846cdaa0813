"""A transform fitted to returns on many surfaces at once, without mapolas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from fusion.registration.direct import Clusters, DirectRegistration, NormalEquations, pair_equations
from fusion.registration.returns.return_heights import (
    CloudOfReturns,
    FixedSurface,
    compared,
    height_of_returns,
)
from fusion.registration.returns.returns_match import match_returns
from fusion.registration.transform import (
    PARAMETERS,
    Model,
    about_origin,
    natural_sizes,
    updated_transform,
)
from fusion.registration.transform.parameters import LIDAR_FRAME, SPC_FRAME
from fusion.surfacematch import MatchOptions
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.grids.correlation import independent_patches
from spcola.math import Affine
from spcola.math.robust import mad

# Number of surfaces matched one by one to find the start.
_START_SAMPLE = 12
# With fewer surfaces than this many times the parameters, surfaces are divided into clusters.
_ENOUGH = 3
# A step that moves the ground by less than this share of a grid step is the last.
_STILL = 1e-3


@dataclass(frozen=True)
class ReturnsOptions:
    """Options of the registration of returns to surfaces.

    Parameters
    ----------
    model : {"rigid", "similarity", "affine"}
    capture_m : float
        Largest horizontal displacement that is searched, metres.
    min_coverage : float
        Smallest share of the grid points of a surface with returns.
    max_iterations : int
        Largest number of Gauss–Newton steps.
    """

    model: Model = "similarity"
    capture_m: float = 2.0
    min_coverage: float = 0.1
    max_iterations: int = 20


def register_returns(
    returns: CloudOfReturns,
    surfaces: Sequence[FixedSurface],
    *,
    options: ReturnsOptions | None = None,
    start: Affine | None = None,
) -> DirectRegistration:
    """Fit the transform that takes returns to SPC surfaces (Gaskell et al. §6.1, second approach).

    At each Gauss–Newton step every return is moved, its height above each surface it falls on is
    read where it lies, and the differences are brought to the surface's resolution.

    Parameters
    ----------
    returns : CloudOfReturns
        For example of one scan; lidar coordinates.
    surfaces : sequence of FixedSurface
        Maplets, or one bigmap. Errors of different surfaces count as independent.
    options : ReturnsOptions, optional
    start : Affine, optional
        First estimate; searched within the capture range if not given.

    Returns
    -------
    DirectRegistration
        From lidar to SPC coordinates. Its covariance treats errors of one surface as correlated;
        where there are few surfaces, those of squares several correlation lengths wide.

    Raises
    ------
    NotObservableError
        If no surface is matched, or the ground does not determine a parameter.
    """
    options = options or ReturnsOptions()
    near = _near(returns, surfaces, options.capture_m)
    transform = start or _started(near, options)
    names, middles = PARAMETERS[options.model], np.array([at.grid.center for _, at in near])
    center = transform.inverse().apply(middles.mean(axis=0))
    natural = natural_sizes(names, max(_reach(near, middles), 1e-6))
    shortest = min(fixed.grid.gsd for _, fixed in near)
    iterations, converged, rounds = 0, False, _Round(options, len(near) >= _ENOUGH * len(names))
    while not converged and iterations < options.max_iterations:
        iterations += 1
        found = rounds.equations(near, transform, center)
        step = found.solve(names, natural)
        transform = updated_transform(transform, step, options.model, center)
        converged = iterations > 1 and float(np.max(np.abs(step) / natural)) < _STILL * shortest
    return DirectRegistration(
        transform=transform,
        model=options.model,
        covariance=about_origin(found.covariance(rounds.inside), options.model, transform, center),
        center=center,
        blur_cells=float(np.mean([fixed.blur_cells for _, fixed in near])),
        residual_std_m=float(mad(rounds.differences)),
        points=sum(len(some) for some, _ in near),
        cells=int(found.cells.sum()),
        clusters=int(np.count_nonzero(found.cells)),
        iterations=iterations,
        converged=converged,
    )


class _Round:
    """The equations of one step over all surfaces, and the clusters of their cells."""

    def __init__(self, options: ReturnsOptions, whole: bool) -> None:
        self.options, self.whole = options, whole
        self.clusters: Clusters | None = None
        self.differences: FloatArray = np.empty(0)

    @property
    def inside(self) -> float:
        """Share of the correlation of errors that lies within clusters."""
        return self.clusters.inside if self.clusters else 1.0

    def equations(
        self, near: list[tuple[CloudOfReturns, FixedSurface]], transform: Affine, about: FloatArray
    ) -> NormalEquations:
        """Return the sum of the normal equations of all surfaces."""
        parts, differences, areas = [], [], []
        size = len(PARAMETERS[self.options.model])
        for some, fixed in near:
            lidar = height_of_returns(some, fixed, transform)
            if np.isfinite(lidar.height).mean() < self.options.min_coverage:
                continue
            pair = compared(lidar, fixed)
            difference = pair.fixed - pair.moving
            block = self.clusters.block if self.clusters else len(difference)
            parts.append(pair_equations(pair, fixed.grid, transform, about, size=size, block=block))
            differences.append(difference[np.isfinite(difference)])
            if not self.whole:
                areas.append(np.isfinite(difference).sum() / independent_patches(difference))
        if not parts:
            raise NotObservableError(
                "the returns cover none of the surfaces", do="lower the required coverage"
            )
        if areas:
            points = int(np.sqrt(sum(len(fixed.height) ** 2 for _, fixed in near)))
            self.clusters = Clusters.of(float(np.median(areas)), points, size)
        self.differences = np.concatenate(differences)
        return NormalEquations.joined(parts)


def _near(
    returns: CloudOfReturns, surfaces: Sequence[FixedSurface], margin: float
) -> list[tuple[CloudOfReturns, FixedSurface]]:
    """Return each surface with the returns that a move by `margin`, metres, may put on it.

    Surfaces without any are left out.
    """
    tree = cKDTree(returns.points)
    found = []
    for fixed in surfaces:
        grid = fixed.grid
        side = (grid.half_size + 0.5) * grid.gsd + margin
        ball = tree.query_ball_point(grid.center, np.sqrt(3.0) * side, return_sorted=True)
        rows = np.array(ball, dtype=np.int64)
        along = (returns.points[rows] - grid.center) @ grid.axes.T
        rows = rows[np.all(np.abs(along) <= side, axis=1)]
        if len(rows):
            found.append((CloudOfReturns(returns.points[rows], returns.sigma[rows]), fixed))
    return found


def _reach(near: list[tuple[CloudOfReturns, FixedSurface]], middles: FloatArray) -> float:
    """Root mean square distance of the ground from its middle, metres."""
    apart = np.mean(np.sum((middles - middles.mean(axis=0)) ** 2, axis=1))
    own = np.mean([fixed.grid.radius**2 / 3.0 for _, fixed in near])
    return float(np.sqrt(apart + own))


def _started(near: list[tuple[CloudOfReturns, FixedSurface]], options: ReturnsOptions) -> Affine:
    """Return the median displacement of single surfaces."""
    matching = MatchOptions(capture_m=options.capture_m, min_coverage=options.min_coverage)
    sample = near[:: -(-len(near) // _START_SAMPLE)] if near else []
    matches = [match_returns("", some, fixed, options=matching) for some, fixed in sample]
    found = [match.displacement for match in matches if match.usable]
    if not found:
        why = matches[0].reason if matches else "no return falls on them"
        raise NotObservableError(
            f"the returns match none of the surfaces ({why})", do="raise the capture range"
        )
    return Affine(np.eye(3), np.median(found, axis=0), SPC_FRAME, LIDAR_FRAME)
