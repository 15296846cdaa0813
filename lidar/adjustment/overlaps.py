"""Normal equations of the displacements of scans that overlap on one grid.

In one cell of a mapola every scan has a mean height. Their differences do not depend on the ground
but on the displacements of the scans: directly on the vertical part, and through the slope of the
ground on the horizontal part. The height of each cell is an unknown that is eliminated at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.sparse import csr_array

from lidar.gridding import Gridding, GriddingOptions
from lidar.gridding.cells import CellReturns, PlaneFit, fit_planes, sort_into_cells
from lidar.scans import Returns
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.grids import MapletGrid
from spcola.math.robust import mad

COMPONENTS = 6
"""Components of a small rigid displacement: three of translation, three of rotation."""

# A scan that departs from the others in a cell by more than this many robust deviations observed
# another part of the ground: the edge of a boulder, from another side.
_REJECT = 4.0
# Squared slopes up to so many times their mean due to noise count as noise, which exceeds it once
# in e⁹ cells.
_NOISE = 9.0
# Sigma of a return where neither the file nor any cell of three returns determines it, metres.
_UNKNOWN_SIGMA = GriddingOptions().default_sigma_m
# Returns of a cell from which on its own spread is used, not only that of the grid.
_ENOUGH = 6


@dataclass(frozen=True, eq=False)
class OverlapEquations:
    """Normal equations of the displacements of the K scans that meet on one grid.

    Attributes
    ----------
    scan : (K,) ndarray of int
        Numbers of these scans.
    normal : (6K, 6K) ndarray
    right : (6K,) ndarray
        Unknowns of each scan: displacement (metres) and rotation (radians) about its centre of
        its stated points.
    cells : (K,) ndarray
        Cells in which each scan met another.
    chi2, freedom : (K,) ndarrays
        Sum of its squared departures from the others, in their variances, and the degrees of
        freedom.
    weight : float
        Summed weight of all differences, 1/m².
    """

    scan: IntArray
    normal: FloatArray
    right: FloatArray
    cells: FloatArray
    chi2: FloatArray
    freedom: FloatArray
    weight: float


def displacement_partials(points: FloatArray, centers: FloatArray) -> FloatArray:
    """Partials (…, 3, 6) of `points` (…, 3), metres, by displacements of their scans.

    Rotations are about the middles of the scans, `centers` (…, 3).
    """
    arm = points - centers
    shift = np.broadcast_to(np.eye(3), (*arm.shape[:-1], 3, 3))
    turning = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=-1)
    return np.concatenate([shift, turning], axis=-1)


def overlap_equations(
    gridding: Gridding, returns: Returns, centers: FloatArray, *, others: Sequence[MapletGrid] = ()
) -> OverlapEquations | None:
    """Compare the heights of the scans that meet in the cells of a mapola.

    Parameters
    ----------
    gridding : Gridding
        Gridding of `returns`: the surface, its spread, and the returns used.
    returns : Returns
    centers : (S, 3) ndarray
        Points about which the scans of ``returns.scan_names`` are rotated, body-fixed, metres.
    others : sequence of MapletGrid
        Grids of other mapolas on which scans are compared: ground on several of them has its weight
        divided by their number.

    Returns
    -------
    OverlapEquations or None
        None where no two scans meet.
    """
    mapola, used = gridding.mapola, np.flatnonzero(gridding.used)
    grid = mapola.grid
    cells = sort_into_cells(grid, returns.points[used], np.inf)
    scan = returns.scan[used][cells.index]
    if len(scan) == 0 or np.all(scan == scan[0]):
        return None
    planes = fit_planes(
        *cells.place,
        mapola.height,
        cells.count / (cells.count + 1.0),
        baseline=0.3,
        max_radius=3,
    )
    residual = cells.corrected(planes.slope_x, planes.slope_y) - mapola.height.ravel()[cells.cell]
    variance = _variance(cells, mapola.spread, returns.sigma)
    share = ground_shares(grid, others, mapola.height).ravel()
    meetings = _means(cells.cell, scan, residual, variance).agreeing().weighted(share)
    if len(meetings.cell) == 0:
        return None
    trust = _trusted(planes, cells.count, variance.reshape(grid.shape)) / grid.gsd
    slopes = np.stack([-planes.slope_x * trust, -planes.slope_y * trust], axis=-1)
    normals = np.concatenate([slopes, np.ones((*grid.shape, 1))], axis=-1) @ grid.axes
    places = grid.points(np.nan_to_num(mapola.height))
    at = meetings.cell
    displacement = displacement_partials(places.reshape(-1, 3)[at], centers[meetings.scan])
    rows = np.einsum("ni,nij->nj", normals.reshape(-1, 3)[at], displacement)
    return _eliminated(meetings, rows)


def ground_shares(grid: MapletGrid, others: Sequence[MapletGrid], height: FloatArray) -> FloatArray:
    """One over the number of grids (R, C) on which the ground of `grid` lies, itself included.

    `height` (R, C) is that on `grid`, metres.
    """
    number = np.ones(grid.shape)
    points = grid.points(np.nan_to_num(height))
    for other in others:
        x, y, _ = other.project(points)
        side = other.half_size + 0.5
        number += (np.abs(x) <= side) & (np.abs(y) <= side)
    return 1.0 / number


@dataclass(frozen=True, eq=False)
class _Meetings:
    """Mean heights (M,) of scans in cells where they meet, sorted by cell, with their weights."""

    cell: IntArray
    scan: IntArray
    value: FloatArray
    weight: FloatArray

    def select(self, keep: BoolArray) -> _Meetings:
        return _Meetings(self.cell[keep], self.scan[keep], self.value[keep], self.weight[keep])

    def weighted(self, share: FloatArray) -> _Meetings:
        """Return meetings with the weights of cells multiplied by `share` (C,)."""
        return _Meetings(self.cell, self.scan, self.value, self.weight * share[self.cell])

    def together(self) -> _Meetings:
        """Keep cells of more than one scan."""
        return self.select(np.bincount(self.cell)[self.cell] > 1)

    def agreeing(self) -> _Meetings:
        """Keep those that depart from their cell by no more than chance."""
        met = self.together()
        if len(met.cell) == 0:
            return met
        departure = np.sqrt(met.weight) * met.departure()
        near = np.abs(departure) <= _REJECT * max(float(mad(departure)), 1e-12)
        return met.select(near).together()

    @property
    def total(self) -> FloatArray:
        """Weight of each meeting's cell (M,)."""
        total: FloatArray = _summed(self.cell, self.weight)[self.cell]
        return total

    def departure(self) -> FloatArray:
        """Heights (M,) less the mean of their cell."""
        mean: FloatArray = _summed(self.cell, self.weight * self.value)[self.cell] / self.total
        return self.value - mean


def _summed(place: IntArray, values: FloatArray) -> FloatArray:
    """Sum of `values` (M,) by place."""
    return np.bincount(place, weights=values).astype(np.float64)


def _means(cell: IntArray, scan: IntArray, residual: FloatArray, variance: FloatArray) -> _Meetings:
    """Mean of the residuals of each scan in each cell; `variance` (C,) is that of one return."""
    count = int(scan.max()) + 1
    key = cell * count + scan
    order = np.argsort(key, kind="stable")
    start = np.flatnonzero(np.diff(key[order], prepend=-1))
    number = np.diff(start, append=len(key))
    mean = np.add.reduceat(residual[order], start) / number
    where, which = np.divmod(key[order][start], count)
    return _Meetings(where, which, mean, number / variance[where])


def _variance(cells: CellReturns, spread: FloatArray, sigma: FloatArray) -> FloatArray:
    """Variance (C,) of a single return about the plane of its cell, square metres."""
    many = (cells.count >= _ENOUGH) & np.isfinite(spread)
    known = spread[np.isfinite(spread)]
    stated = sigma[np.isfinite(sigma)]
    least = float(np.median(stated)) if stated.size else 0.0
    typical = max(float(np.median(known)) if known.size else 0.0, least) or _UNKNOWN_SIGMA
    return np.where(many, np.maximum(spread, typical / 2.0), typical).ravel() ** 2


def _trusted(planes: PlaneFit, count: IntArray, variance: FloatArray) -> FloatArray:
    """1 where a slope (R, C) exceeds noise, else 0.

    On flat ground the slopes are due to noise; used as slopes of the ground they would seem to
    determine horizontal displacements. `variance` (R, C) is that of a single return.
    """
    weight = uniform_filter(count / (count + 1.0), 3, mode="constant") * 9.0
    # A height of weight 1 has half the variance of a single return; 3 × 3 places scatter by 2/3.
    noise = 2.0 * (variance / 2.0) / np.maximum(weight * 2.0 / 3.0, 1e-12)
    square = planes.slope_x**2 + planes.slope_y**2
    return (square > _NOISE * noise).astype(np.float64)


def _eliminated(meetings: _Meetings, rows: FloatArray) -> OverlapEquations:
    """Sum up the normal equations, with the height of each cell eliminated."""
    scans, own = np.unique(meetings.scan, return_inverse=True)
    cells, place = np.unique(meetings.cell, return_inverse=True)
    columns = COMPONENTS * own[:, None] + np.arange(COMPONENTS)
    numbers = np.repeat(np.arange(len(rows)), COMPONENTS)
    shape = (len(rows), COMPONENTS * len(scans))
    design = csr_array((rows.ravel(), (numbers, columns.ravel())), shape=shape)
    weight = meetings.weight
    sums = csr_array((weight, (place, np.arange(len(rows)))), shape=(len(cells), len(rows)))
    total = _summed(place, weight)
    shared = (sums @ design).toarray() / np.sqrt(total)[:, None]
    weighted = design.multiply(weight[:, None])
    departure = meetings.departure()
    free = 1.0 - weight / meetings.total
    return OverlapEquations(
        scan=scans,
        normal=(design.T @ weighted).toarray() - shared.T @ shared,
        right=weighted.T @ departure,
        cells=np.bincount(own).astype(np.float64),
        chi2=_summed(own, weight * departure**2),
        freedom=_summed(own, free),
        weight=float(weight @ free),
    )
