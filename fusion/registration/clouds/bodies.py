"""Clouds around a body aligned: in patches of the surface, each gridded over its own plane."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.registration.clouds.blur import relative_blur, significant_blur
from fusion.registration.clouds.cloud_grid import grid_cloud
from fusion.registration.clouds.composed import composed
from fusion.registration.clouds.not_aligned import NotAlignedError
from fusion.registration.direct import DirectRegistration
from fusion.registration.judging import ReliefPair, common_relief, judge_relief
from fusion.registration.returns import (
    CloudOfReturns,
    FixedSurface,
    ReturnsOptions,
    height_of_returns,
    register_returns,
)
from fusion.registration.search import Placement, PointSurface, fit_placement, search_frames
from fusion.registration.transform import PARAMETERS, Model
from fusion.surfacematch import Surface
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import NotObservableError
from spcola.grids import MapletGrid
from spcola.math import Affine

# Half sides of patches in parts of the body's radius, and in cells.
_HALF_SIDE, _LEAST_HALF, _MOST_HALF = 0.18, 8, 40
# Least step of the patches' grids in spacings of the moving and of the fixed cloud's points: of the
# moving one a sixth of the cells must hold a point, of the fixed one most.
_SPACINGS = (0.42, 1.22)
# Share of a patch's cells that must hold points of both.
_LEAST_SHARED = 0.05
# Points of the moving cloud that find the first place, and steps of that fit.
_FIRST_POINTS, _FIRST_STEPS = 5000, 40
# Gaussian under which a patch is gridded, cells; that of half the points; cells of a common relief.
_SMOOTH, _HALF_SMOOTH, _REACH = 0.5, 0.7, 3
# Share of a patch's grid that must have points, and how often its heights are refined.
_LEAST_FILLED, _REFINED = 0.15, 2
# Places at which the relief is compared, half their sides in radii, and the most cells of these.
_JUDGED, _JUDGED_HALF, _JUDGED_CELLS = 24, 0.35, 40
_HERE = Affine(np.eye(3), np.zeros(3), "fixed", "fixed")


def align_bodies(
    moving: FloatArray,
    fixed: FloatArray,
    model: Model,
    *,
    origin: FloatArray,
    gsd_m: float = 0.0,
) -> DirectRegistration:
    """Register two clouds around a body, of which the moving one may see a part only.

    A first place is found by fitting points to the planes through the nearest points of the other
    cloud, from where the clouds lie; if the two show no common relief there, among all
    orientations. Then each patch of the fixed surface is gridded, and the transform fitted to the
    differences of all patches together (:func:`fusion.registration.returns.register_returns`).
    Every point of the fixed cloud belongs to one patch: errors of patches are independent.

    Parameters
    ----------
    moving, fixed : (N, 3), (M, 3) ndarrays
        Metres, the origin near the middle of the fixed cloud.
    model : {"rigid", "similarity", "affine"}
    origin : (3,) ndarray
        Where the moving cloud's coordinates began before it was centred, metres: about it
        orientations are tried.
    gsd_m : float
        Least step of the patches' grids, metres.

    Returns
    -------
    DirectRegistration
        With a verdict.

    Raises
    ------
    NotObservableError
        If the clouds do not overlap, or the ground leaves a parameter free.
    """
    spacings = _spacing(moving), _spacing(fixed)
    step = max(_SPACINGS[0] * spacings[0], _SPACINGS[1] * spacings[1], gsd_m)
    patches = _patches(fixed, step)
    gsd = patches[0].grid.gsd
    pair = _Clouds(moving, fixed, patches, max(gsd, 1.2 * spacings[0]), model, origin)
    coarse = PointSurface(fixed, max(2.0 * gsd, _radius(fixed) * np.radians(1.0)))
    here = Placement(np.eye(3), np.zeros(3), 1.0)
    some = moving[:: max(1, len(moving) // _FIRST_POINTS)]
    at, misfit, _ = fit_placement(coarse, some, here, steps=_FIRST_STEPS)
    first = pair.registered(at) if np.isfinite(misfit) else None
    if first is not None and first.verdict is not None and first.verdict.judgement != "refused":
        return first
    return _searched(pair, first)


def _searched(pair: _Clouds, first: DirectRegistration | None) -> DirectRegistration:
    """Look for another orientation; where there is none return what was found, or refuse."""
    low, high = pair.moving.min(axis=0), pair.moving.max(axis=0)
    # A part of a body has its middle elsewhere; body-fixed coordinates begin inside.
    inside = bool(np.all((pair.origin > low) & (pair.origin < high)))
    middle = pair.origin if inside else pair.moving.mean(axis=0)
    search = search_frames(pair.moving - middle, pair.fixed)
    best = search.best
    if best is not None and np.linalg.det(best.placement.matrix) > 0.0:
        at = best.placement
        place = Placement(at.matrix, at.translation - at.scale * at.matrix @ middle, at.scale)
        found = pair.registered(place)
        if found is not None:
            return found
    why = search.text.replace("the lidar", "the moving cloud")
    if best is not None and np.linalg.det(best.placement.matrix) > 0.0 and first is None:
        raise NotAlignedError(
            Code.NOT_DETERMINED, f"{why}, but it is too sparse for the transform to be found",
            "give more points, or look at a smaller part",
        )  # fmt: skip
    if first is None:
        code = Code.RELIEF_UNRELATED if best is None else Code.FITS_OTHERWISE
        raise NotAlignedError(
            code, f"the clouds do not match: {why}",
            "check that they are of one body, and the units",
        )  # fmt: skip
    finding = Finding(Code.FITS_OTHERWISE, Severity.NOTE, why)
    verdict = first.verdict or Verdict()
    return replace(first, verdict=Verdict((*verdict.findings, finding)))


@dataclass(frozen=True, eq=False)
class _Clouds:
    """A moving cloud, a fixed one with its patches, and the model of the transform.

    `relief_gsd` is the step of the grids, metres, on which both have points in most cells, `origin`
    a point (3,) of the moving cloud's frame, metres.
    """

    moving: FloatArray
    fixed: FloatArray
    patches: list[FixedSurface]
    relief_gsd: float
    model: Model
    origin: FloatArray

    @cached_property
    def tree(self) -> cKDTree:
        """The fixed cloud, to be asked for what is near a place."""
        return cKDTree(self.fixed)

    def registered(self, at: Placement) -> DirectRegistration | None:
        """Fit the transform from a first place; None where the clouds do not match there."""
        scale = 1.0 if self.model == "rigid" else at.scale
        before = Affine(scale * at.matrix, at.translation, "fixed", "moving")
        placed = before.apply(self.moving)
        gsd = self.patches[0].grid.gsd
        options = ReturnsOptions(model=self.model, capture_m=3.0 * gsd, min_coverage=_LEAST_SHARED)
        none = Affine(np.eye(3), np.zeros(3), "fixed", "moving")
        returns = CloudOfReturns(placed, np.full(len(placed), np.nan))
        # Where the first place is wrong, patches have nothing in common with the moving cloud.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            blur = self._blur(placed)
            surfaces = [replace(patch, blur_cells=blur) for patch in self.patches]
            try:
                found = register_returns(returns, surfaces, options=options, start=none)
            except NotObservableError as error:
                if 0 < len(error.parameters) < len(PARAMETERS[self.model]):
                    raise
                return None
        verdict = self._judged(found, found.transform.apply(placed))
        return replace(composed(found, before), verdict=verdict)

    def _blur(self, placed: FloatArray) -> float:
        """Blur of the fixed cloud's ground against the moving one's, cells, from all patches."""
        if self.relief_gsd > self.patches[0].grid.gsd:
            return 0.0
        squares, weights, trees = [], [], (cKDTree(placed), self.tree)
        for patch in self.patches[:: max(1, len(self.patches) // _JUDGED)]:
            one, two = (_halves(tree, patch.grid) for tree in trees)
            square, sigma = relative_blur(one, two)
            if np.isfinite(square) and sigma > 0.0:
                squares.append(square)
                weights.append(1.0 / sigma**2)
        if not squares:
            return 0.0
        mean = float(np.average(squares, weights=weights))
        return significant_blur(mean, float(1.0 / np.sqrt(np.sum(weights))))

    def _judged(self, found: DirectRegistration, moved: FloatArray) -> Verdict:
        """Judge by the relief that both clouds show around some of the patches."""
        side = _JUDGED_HALF * _radius(self.fixed)
        step = max(self.relief_gsd, side / _JUDGED_CELLS)
        centers = np.array([patch.grid.center for patch in self.patches])
        trees = cKDTree(moved), self.tree
        away, _ = trees[0].query(centers)
        shared = [self.patches[k] for k in np.flatnonzero(away < 3.0 * step)]
        compared = []
        for patch in shared[:: max(1, len(shared) // _JUDGED)]:
            grid = replace(patch.grid, gsd=step, half_size=int(np.ceil(side / step)))
            one, two = (_gridded(_about(tree, grid), grid) for tree in trees)
            compared.append(ReliefPair(one, two, np.zeros(2), _REACH))
        findings = list(judge_relief(common_relief(compared)))
        if not found.converged:
            text = f"the transform still moved after {found.iterations} steps"
            findings.append(Finding(Code.NOT_CONVERGED, Severity.DOUBTFUL, text))
        return Verdict(tuple(findings))


def _radius(points: FloatArray) -> float:
    """Median distance from the origin, metres."""
    return float(np.median(np.linalg.norm(points, axis=1)))


def _spacing(points: FloatArray) -> float:
    """Distance of points from their neighbours, metres: the root of the area that each one has.

    A plane passes through 1.5 cubes of an edge h for each h² of its area, whichever way it lies.
    """
    arms = points - points.mean(axis=0)
    edge = _radius(arms) / 12.0
    cubes = len(np.unique(np.floor(arms / edge).astype(np.int64), axis=0))
    return float(edge * np.sqrt(cubes / 1.5 / len(points)))


def _patches(fixed: FloatArray, gsd: float) -> list[FixedSurface]:
    """Part a cloud into patches, each gridded over the plane through its points.

    Each point belongs to the nearest of centres that are about as far apart as patches are wide.
    """
    half = int(np.clip(_HALF_SIDE * _radius(fixed) / gsd, _LEAST_HALF, _MOST_HALF))
    centers = PointSurface(fixed, 1.3 * half * gsd).points
    owner = np.asarray(cKDTree(centers).query(fixed)[1])
    order = np.argsort(owner, kind="stable")
    begins = np.searchsorted(owner[order], np.arange(len(centers) + 1))
    found = []
    for number in range(len(centers)):
        patch = _patch(fixed, order[begins[number] : begins[number + 1]], gsd, half)
        if patch is not None:
            found.append(patch)
    if not found:
        raise NotAlignedError(
            Code.NOT_DETERMINED, "the fixed cloud has too few points for its surface to be gridded"
        )
    return found


def _patch(fixed: FloatArray, rows: AnyArray, gsd: float, half: int) -> FixedSurface | None:
    """Grid the points of a patch; None where they are too few or lie along a line."""
    if len(rows) < 4 * half:
        return None
    points = np.ascontiguousarray(fixed[rows])
    middle = points.mean(axis=0)
    some = points[:: max(1, len(points) // 2000)] - middle
    spans, axes = np.linalg.eigh(some.T @ some)
    if spans[1] < 1e-2 * spans[2]:
        return None
    normal = axes[:, 0] * (1.0 if axes[:, 0] @ middle >= 0 else -1.0)
    grid = MapletGrid.facing(middle, normal, gsd, half)
    height = _gridded(points, grid)
    if np.isfinite(height).mean() < _LEAST_FILLED:
        return None
    own = CloudOfReturns(points, np.full(len(points), np.nan))
    for _ in range(_REFINED):
        # Means of cells lie below a round body. By how much is seen in the patch's own points,
        # compared in the way that the moving cloud's will be.
        height = height_of_returns(own, FixedSurface(grid, Surface(height)), _HERE).height
    return FixedSurface(grid, Surface(height))


def _halves(tree: cKDTree, grid: MapletGrid) -> tuple[FloatArray, FloatArray]:
    """Surfaces of every other point about a patch, and of the rest."""
    near = _about(tree, grid)
    one, two = (
        _gridded(np.ascontiguousarray(near[part::2]), grid, _HALF_SMOOTH) for part in range(2)
    )
    return one, two


def _about(tree: cKDTree, grid: MapletGrid) -> FloatArray:
    """Points of a tree within a grid's square, and no further from its plane than half a side."""
    side = (grid.half_size + 0.5) * grid.gsd
    rows = np.array(
        tree.query_ball_point(grid.center, np.sqrt(3.0) * side, return_sorted=True), dtype=np.int64
    )
    points = tree.data[rows]
    inside = np.all(np.abs((points - grid.center) @ grid.axes.T) <= side, axis=1)
    return np.ascontiguousarray(points[inside])


def _gridded(points: FloatArray, grid: MapletGrid, smooth: float = _SMOOTH) -> FloatArray:
    """Heights of points on a grid, metres, averaged under a Gaussian of `smooth` cells."""
    flat = np.zeros(grid.shape)
    return grid_cloud(points, grid, _HERE).surface(flat, flat, smooth)[0]
