"""Two clouds on one grid, and the steps of the transform there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from fusion.estimation.verdict import Code
from fusion.registration.clouds.blur import relative_blur, significant_blur
from fusion.registration.clouds.cloud_grid import CloudGrid, grid_cloud
from fusion.registration.clouds.not_aligned import NotAlignedError
from fusion.registration.direct import (
    Clusters,
    DirectRegistration,
    NormalEquations,
    SurfacePair,
    pair_equations,
)
from fusion.registration.transform.parameters import (
    PARAMETERS,
    Model,
    about_origin,
    natural_sizes,
    updated_transform,
)
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.grids.correlation import independent_patches
from spcola.math import Affine
from spcola.math.robust import huber_weight, mad

# A level is left when the transform moves the ground by less than this share of a step.
_STILL = 2e-4
# Or by less than this share of its sigmas.
_SMALL = 0.05
# Share of the ground around a point that must be there where one surface is smoothed.
_WHOLE = 0.98
# Cells at the rim of the ground that both have which do not count.
_RIM = 2
# Largest number of points from which a scatter is estimated.
_SAMPLE = 100_000
# Gaussian, steps, under which half of the points leave hardly a gap.
HALF_SMOOTH = 0.7


@dataclass(frozen=True)
class CloudOptions:
    """How two clouds are registered.

    Parameters
    ----------
    model : {"rigid", "similarity", "affine"}
    gsd_m : float
        Step of the finest grid, metres; 0: one point of the sparser cloud in a cell.
    smooth_cells : float
        Gaussian under which the points of both clouds are averaged, steps.
    blur_cells : float, optional
        Blur of the fixed cloud's ground against the moving one's, steps (negative where the moving
        one is the softer); estimated if not given.
    capture_m : float
        Largest displacement that is searched, metres.
    reject : float
        Points further than this many robust standard deviations from the surface do not enter.
    max_iterations : int
        Most Gauss–Newton steps on each grid.
    """

    model: Model = "similarity"
    gsd_m: float = 0.0
    smooth_cells: float = 0.5
    blur_cells: float | None = None
    capture_m: float = 1.0
    reject: float = 6.0
    max_iterations: int = 15


class State(NamedTuple):
    """The last step at a level."""

    transform: Affine
    center: FloatArray  # the point of the moving frame about which the parameters act
    equations: NormalEquations
    difference: FloatArray
    blur: float
    clusters: Clusters
    points: int
    iterations: int
    converged: bool


class Level:
    """Both clouds on one grid, and the steps of the transform there."""

    def __init__(
        self,
        moving: FloatArray,
        fixed: FloatArray,
        grid: MapletGrid,
        options: CloudOptions,
        start: Affine,
    ) -> None:
        self.moving, self.fixed_points, self.grid, self.options = moving, fixed, grid, options
        self.names = PARAMETERS[options.model]
        self.here = Affine(np.eye(3), np.zeros(3), "fixed", "fixed")
        self.slopes = np.zeros((2, *grid.shape))
        self.fixed = grid_cloud(fixed, grid, self.here)
        height = self._surface(self.fixed, 0.0)[0]
        # A fixed cloud with hardly a point in a cell has no scatter of its own there; what the
        # moving one has about it must not be taken for outliers.
        scatter = max(_scatter(each, grid, height) for each in (fixed, start.apply(moving)))
        self.limit = options.reject * scatter
        self.expected = height
        self.fixed = self._gridded(fixed, self.here)
        self._slopes_of(self._surface(self.fixed, 0.0)[0])

    def fitted(self, transform: Affine, *, finest: bool) -> State:
        """Step until the transform stands still."""
        blur, iterations, converged = self.options.blur_cells or 0.0, 0, False
        clusters = Clusters(self.grid.size)
        if finest and self.options.blur_cells is None:
            blur = self._blur(transform)
        center = transform.inverse().apply(self.grid.center)
        # The middling distance from the centre: a turn or stretch by 1/reach moves that by 1 m.
        reach = self.grid.half_size * self.grid.gsd / np.sqrt(1.5)
        natural = natural_sizes(self.names, reach)
        last: FloatArray = np.zeros(len(self.names))
        damping = 1.0
        while not converged and iterations < self.options.max_iterations:
            iterations += 1
            cloud = self._gridded(self.moving, transform)
            pair, difference = self._pair(cloud, blur if finest else 0.0)
            found = pair_equations(
                pair, self.grid, transform, center, size=len(self.names), block=clusters.block
            )
            try:
                step = found.solve(self.names, natural)
            except NotObservableError:
                self._check_unrelated(transform, center, natural)
                raise
            # Noise in the slopes makes steps too long: those that turn back are made shorter.
            damping *= 0.5 if (step / natural) @ (last / natural) < 0.0 else 1.0
            last = step
            transform = updated_transform(transform, damping * step, self.options.model, center)
            moved = float(np.max(np.abs(step) / natural)) / self.grid.gsd
            converged = moved < (_STILL if finest else 0.1)
            if finest and clusters.inside < 1.0:
                # Points that pass from cell to cell may keep a transform in motion for ever.
                spread = np.sqrt(np.diag(found.covariance(clusters.inside)))
                converged |= bool(np.all(np.abs(step) < _SMALL * spread))
            if finest and clusters.inside == 1.0:
                area = np.isfinite(difference).sum() / independent_patches(difference)
                clusters = Clusters.of(area, self.grid.size, len(self.names))
                converged = False
        return State(
            transform,
            center,
            found,
            difference,
            blur,
            clusters,
            cloud.points,
            iterations,
            converged,
        )

    def _check_unrelated(self, transform: Affine, center: FloatArray, natural: FloatArray) -> None:
        """Refuse two clouds of which each determines the parameters by the relief of its own.

        Relief that both halves of one cloud have is no noise: then the clouds show other ground.
        """
        for points, frame in ((self.moving, transform), (self.fixed_points, self.here)):
            one, two = self._halves(points, frame)
            known = np.isfinite(one - two).astype(np.float64)
            pair = SurfacePair(one, two, known, known)
            own = pair_equations(
                pair, self.grid, transform, center, size=len(self.names), block=self.grid.size
            )
            try:
                own.solve(self.names, natural)
            except NotObservableError:
                return
        raise NotAlignedError(
            Code.RELIEF_UNRELATED, "both clouds have relief, but none in common",
            "check that they show the same ground in the same frame",
        )  # fmt: skip

    def result(self, state: State) -> DirectRegistration:
        """Return what other programs need of the last state."""
        model, equations = self.options.model, state.equations
        spread = equations.covariance(state.clusters.inside)
        return DirectRegistration(
            transform=state.transform,
            model=model,
            covariance=about_origin(spread, model, state.transform, state.center),
            center=state.center,
            blur_cells=state.blur,
            residual_std_m=float(mad(state.difference[::3, ::3])),
            points=state.points,
            cells=int(equations.cells.sum()),
            clusters=int(np.count_nonzero(equations.cells)),
            iterations=state.iterations,
            converged=state.converged,
        )

    def _gridded(self, points: FloatArray, frame: Affine) -> CloudGrid:
        """Grid points, outliers left out."""
        return grid_cloud(points, self.grid, frame, expected=self.expected, limit_m=self.limit)

    def _surface(self, cloud: CloudGrid, blur: float) -> tuple[FloatArray, FloatArray]:
        """Heights and their weights, `blur` steps softer than the other cloud's are."""
        soft = float(np.hypot(self.options.smooth_cells, max(blur, 0.0)))
        return cloud.surface(self.slopes[0], self.slopes[1], soft)

    def _slopes_of(self, height: FloatArray) -> None:
        down, along = np.gradient(height, self.grid.gsd)
        self.slopes = np.nan_to_num(np.stack([along, down]))

    def _pair(self, cloud: CloudGrid, blur: float) -> tuple[SurfacePair, FloatArray]:
        """Both surfaces, weighed by their points and robustly; and their difference."""
        fixed, weights = self._surface(self.fixed, -blur)
        moving, others = self._surface(cloud, blur)
        self._slopes_of(np.where(np.isfinite(moving), 0.5 * (fixed + moving), fixed))
        weight = weights * others / np.maximum(weights + others, 1e-12)
        difference = fixed - moving
        standard = difference * np.sqrt(weight)
        if blur:
            # Smoothed over its rim a surface has nothing to be like on the other side.
            rim = ndimage.gaussian_filter(
                np.isfinite(difference).astype(np.float64), abs(blur), mode="constant"
            )
            weight = np.where(rim > _WHOLE, weight, 0.0)
        weight = np.where(_inside_rim(np.isfinite(difference)), weight, 0.0)
        robust = huber_weight(standard / max(float(mad(standard[::3, ::3])), 1e-12), k=2.0)
        return SurfacePair(fixed, moving, weight, robust), difference

    def _blur(self, transform: Affine) -> float:
        """Blur of the fixed cloud's ground against the moving one's, steps."""
        moving = self._halves(self.moving, transform)
        return significant_blur(*relative_blur(moving, self._halves(self.fixed_points, self.here)))

    def _halves(self, points: FloatArray, frame: Affine) -> tuple[FloatArray, FloatArray]:
        """Surfaces of every other point, and of the rest; nothing in one is from the other."""
        flat = np.zeros(self.grid.shape)
        one, two = (self._gridded(points[part::2], frame) for part in range(2))
        return one.surface(flat, flat, HALF_SMOOTH)[0], two.surface(flat, flat, HALF_SMOOTH)[0]


def _inside_rim(known: BoolArray) -> BoolArray:
    """Mask (N, N) of known cells away from the rim, where cells are filled in part.

    That bends heights on slopes, and the scale with them. Tracks a few cells wide are all rim: they
    are kept whole.
    """
    whole = ndimage.binary_fill_holes(known)
    inner: BoolArray = known & ndimage.binary_erosion(whole, iterations=_RIM)
    return inner if 2 * np.count_nonzero(inner) > np.count_nonzero(known) else known


def _scatter(points: FloatArray, grid: MapletGrid, height: FloatArray) -> float:
    """Robust standard deviation of points about a surface on a grid, metres."""
    x, y, z = grid.project(points[:: max(1, len(points) // _SAMPLE)])
    half = grid.half_size
    column, row = (np.rint(at).astype(np.int64) + half for at in (x, y))
    inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) <= 2 * half)
    return max(float(mad(z[inside] - height[row[inside], column[inside]])), 1e-9)
