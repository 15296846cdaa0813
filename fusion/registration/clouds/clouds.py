"""The transform between two clouds of points of one terrain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from fusion.estimation.verdict import Code, Finding, Severity, Verdict
from fusion.registration.clouds.cloud_grid import grid_cloud
from fusion.registration.clouds.level import HALF_SMOOTH, CloudOptions, Level
from fusion.registration.clouds.not_aligned import NotAlignedError
from fusion.registration.direct import (
    DirectRegistration,
)
from fusion.registration.judging.common_ground import (
    CommonRelief,
    ReliefPair,
    common_relief,
)
from fusion.registration.judging.judging import judge_relief
from spcola.arrays import FloatArray, check_finite, check_shape
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.grids.correlation import shift_variances
from spcola.grids.gaps import filled
from spcola.math import Affine

# Grids on the way to the finest one, in its steps.
_COARSER = (4.0, 2.0, 1.0)
# Half the cells along a side that a coarser grid must have.
_LEAST_HALF = 8
# Whole steps of the search over the capture range.
_SEARCH = 10
# Cells along a side on which the relief of two clouds is compared, and how far around.
_JUDGED_SIZE = 128
_JUDGED_REACH = 3


def register_clouds(
    moving: FloatArray, fixed: FloatArray, *, options: CloudOptions | None = None
) -> DirectRegistration:
    """Fit the transform that takes the moving cloud to the fixed one.

    Both are gridded in the same cells, the moving one anew at every step: both are smoothed alike
    by that, and nothing is resampled. A blur of one against the other is given to the sharper one.

    Parameters
    ----------
    moving, fixed : (N, 3), (M, 3) ndarrays
        Metres, of ground that is a surface over one plane.
    options : CloudOptions, optional

    Returns
    -------
    DirectRegistration
        From the frame "moving" to "fixed", with a verdict: it is refused if the two show no relief
        in common where it puts them.

    Raises
    ------
    NotObservableError
        If the ground leaves a parameter free, or the clouds hardly overlap.
    InvalidValueError
        If an array is no cloud of at least 100 points.
    """
    options = options or CloudOptions()
    for name, points in (("moving", moving), ("fixed", fixed)):
        check_shape(points, (None, 3), name)
        check_finite(points, name)
        if len(points) < 100:
            raise InvalidValueError(f"has {len(points)} points, 100 are needed", name)
    grid = grid_over(fixed, len(moving), options.gsd_m)
    transform = searched(moving, fixed, grid, options)
    for coarser in _COARSER:
        if coarser > _COARSER[-1] and grid.half_size < coarser * _LEAST_HALF:
            continue
        # A cell of a coarser grid holds more points than it takes to come nearer.
        some, others = (np.ascontiguousarray(each[:: int(coarser)]) for each in (moving, fixed))
        level = Level(some, others, grid.with_gsd(coarser * grid.gsd), options, transform)
        state = level.fitted(transform, finest=coarser == _COARSER[-1])
        transform = state.transform
    found = level.result(state)
    return replace(found, verdict=_judged(moving, fixed, grid, found))


def _judged(
    moving: FloatArray, fixed: FloatArray, grid: MapletGrid, found: DirectRegistration
) -> Verdict:
    """Judge the registration of two clouds by the relief that they show on a grid over both."""
    findings = list(judge_relief(relief_of(moving, fixed, grid, found.transform)))
    if not found.converged:
        text = f"the transform still moved after {found.iterations} steps"
        findings.append(Finding(Code.NOT_CONVERGED, Severity.DOUBTFUL, text))
    return Verdict(tuple(findings))


def relief_of(
    moving: FloatArray, fixed: FloatArray, grid: MapletGrid, transform: Affine
) -> CommonRelief:
    """Compare the relief of two clouds (N, 3), (M, 3), metres, where a transform places the first.

    The grid lies over both; it is made coarser for the comparison if it is large.
    """
    step = max(1.0, grid.size / _JUDGED_SIZE)
    wide = grid.with_gsd(step * grid.gsd)
    here = Affine(np.eye(3), np.zeros(3), "fixed", "fixed")
    flat, thinned = np.zeros(wide.shape), max(1, int(step))
    one, two = (
        grid_cloud(points[::thinned], wide, frame).surface(flat, flat, HALF_SMOOTH)[0]
        for points, frame in ((moving, transform), (fixed, here))
    )
    return common_relief([ReliefPair(one, two, np.zeros(2), _JUDGED_REACH)])


def grid_over(points: FloatArray, others: int, gsd: float) -> MapletGrid:
    """Return a square grid along the mean plane of `points` (N, 3), its Uz away from the origin.

    Its sides lie along those of the smallest rectangle around the points: their spectra are taken.
    """
    center = np.mean(points, axis=0)
    arms = points - center
    plane = np.linalg.eigh(arms.T @ arms)[1].T[::-1]
    uz = plane[2] * (1.0 if plane[2] @ center >= 0 else -1.0)
    flat = arms @ plane[:2].T
    hull = ConvexHull(flat)
    rim = flat[hull.vertices]
    edges = np.roll(rim, -1, axis=0) - rim
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    sides = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=1)
    spans = rim @ sides.transpose(0, 2, 1)
    low, high = spans.min(axis=1), spans.max(axis=1)
    best = int(np.argmin(np.prod(high - low, axis=1)))
    ux = sides[best, 0] @ plane[:2]
    axes = np.stack([ux, np.cross(uz, ux), uz])
    across = arms @ axes[:2].T
    low, high = across.min(axis=0), across.max(axis=0)
    if not gsd:
        gsd = float(np.sqrt(hull.volume / min(len(points), others)))
    middle = center + (low + high) / 2.0 @ axes[:2]
    return MapletGrid(middle, axes, gsd, max(2, int(np.ceil(np.max(high - low) / 2.0 / gsd))))


def searched(
    moving: FloatArray, fixed: FloatArray, grid: MapletGrid, options: CloudOptions
) -> Affine:
    """Return the best translation by whole steps within the capture range.

    Raises
    ------
    NotAlignedError
        If the clouds hardly overlap.
    """
    none = Affine(np.eye(3), np.zeros(3), "fixed", "moving")
    wide = grid.with_gsd(max(options.capture_m / _SEARCH, grid.gsd))
    reach = int(np.ceil(options.capture_m / wide.gsd))
    flat = np.zeros(wide.shape)
    one = grid_cloud(moving, wide, none).surface(flat, flat, 0.0)[0]
    two = grid_cloud(fixed, wide, none).surface(flat, flat, 0.0)[0]
    held = np.isfinite(one), np.isfinite(two)
    variance = shift_variances(
        filled(one), held[0], filled(two), held[1].astype(np.float64), reach=reach
    )
    if not np.isfinite(variance).any():
        raise NotAlignedError(
            Code.NO_OVERLAP, "the clouds hardly overlap", "raise the capture range"
        )
    row, column = np.unravel_index(int(np.nanargmin(variance)), variance.shape)
    steps = int(row) - reach, int(column) - reach
    across = np.array(steps[::-1]) * wide.gsd
    # Of the ground that both have there: one may reach further than the other.
    up = float(np.nanmedian(two - ndimage.shift(one, steps, order=0, cval=np.nan)))
    return replace(none, translation=np.array([*across, up]) @ wide.axes)
