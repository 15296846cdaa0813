"""Projection of a maplet into the frame of another grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled
from spcola.grids.maplet import Maplet, MapletGrid

_BORDER = 1e-4
"""Share of a cell by which a point may lie outside of it: axes in files are orthonormal to seven
digits only, and points on the rim of a maplet must not be lost for that."""


@dataclass(frozen=True, eq=False)
class ProjectedMaplet:
    """A maplet sampled at the points of another grid, or of a window of that grid.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres along the grid's Uz; NaN where the maplet does not reach.
    slope_x, slope_y : (R, C) ndarrays
        ∂h/∂x and ∂h/∂y in the grid's frame, dimensionless.
    albedo : (R, C) ndarray
        Relative albedo.
    sigma : (R, C) ndarray
        One standard deviation of the height along the grid's Uz, metres; NaN where unknown.
    rows, columns : slice
        Window of the grid that the layers cover.
    """

    height: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray
    albedo: FloatArray
    sigma: FloatArray
    rows: slice
    columns: slice

    @property
    def valid(self) -> BoolArray:
        """Mask (R, C) of points that the maplet reaches."""
        return np.isfinite(self.height)


def project_maplet(source: Maplet, grid: MapletGrid) -> ProjectedMaplet:
    """Sample `source` at every point of `grid` (Gaskell et al., eqs. 24–27, 30, 31).

    Parameters
    ----------
    source : Maplet
        Cells with an unknown corner are left out.
    grid : MapletGrid
        Where to sample; body-fixed, like the source's grid.

    Returns
    -------
    ProjectedMaplet
        Layers of ``grid.shape``, NaN where the maplet does not reach or its cells are folded over
        in this frame. Where several sheets lie above one point, the outermost (highest) one is
        used.
    """
    window = project_window(source, grid)
    whole = slice(0, grid.size)

    def spread(layer: FloatArray) -> FloatArray:
        out = np.full(grid.shape, np.nan)
        out[window.rows, window.columns] = layer
        return out

    return ProjectedMaplet(
        spread(window.height),
        spread(window.slope_x),
        spread(window.slope_y),
        spread(window.albedo),
        spread(window.sigma),
        whole,
        whole,
    )


def project_window(source: Maplet, grid: MapletGrid) -> ProjectedMaplet:
    """Sample `source` like :func:`project_maplet`, on the part of `grid` that it can reach.

    The layers have the shape of that window, which may be empty: for large grids and many
    small maplets.
    """
    x, y, height = grid.project(source.points())
    column, row = x + grid.half_size, y + grid.half_size
    rows, columns = _span(row, grid.size), _span(column, grid.size)
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    layers = tuple(np.full(shape, np.nan) for _ in range(5))
    if shape[0] > 0 and shape[1] > 0:
        corners = np.stack([row - rows.start, column - columns.start, height])
        albedo, sigma = map(np.ascontiguousarray, (source.albedo, source.sigma))
        _project_cells(corners, albedo, sigma, layers, 10 * _BORDER * grid.gsd)
    level, slope_x, slope_y, albedo, sigma = layers
    slope_x, slope_y = slope_x / grid.gsd, slope_y / grid.gsd
    # A surface moved along the source's Uz moves, at fixed x and y of this grid, by this factor.
    along_x, along_y, along_z = grid.axes @ source.grid.uz
    sigma = sigma * np.abs(along_z - slope_x * along_x - slope_y * along_y)
    return ProjectedMaplet(level, slope_x, slope_y, albedo, sigma, rows, columns)


def _span(position: FloatArray, size: int) -> slice:
    """Return the grid indices between the minimum and maximum of `position` (NaN ignored)."""
    known = position[np.isfinite(position)]
    if known.size == 0:
        return slice(0, 0)
    low = int(np.clip(np.ceil(known.min() - _BORDER), 0, size))
    high = int(np.clip(np.floor(known.max() + _BORDER) + 1, 0, size))
    return slice(low, max(low, high))


@compiled
def _project_cells(
    corners: FloatArray,
    albedo: FloatArray,
    sigma: FloatArray,
    layers: tuple[FloatArray, ...],
    same_height: float,
) -> None:
    """Sample every cell of a source at the grid points inside it.

    `corners` (3, …) are row, column and height of the source's points in the target window.
    Points on the border of cells get the mean slope of these cells (so that a maplet projected
    onto itself has central differences as slopes); heights closer than `same_height` are one
    sheet. Slopes are in metres per grid step.
    """
    height, slope_x, slope_y, albedo_out, sigma_out = layers
    sharing = np.zeros(height.shape, dtype=np.int64)
    box = np.empty(4, dtype=np.int64)
    for i in range(corners.shape[1] - 1):
        for j in range(corners.shape[2] - 1):
            Y0, Y1, Y2, Y3 = _bilinear(corners[0], i, j)
            X0, X1, X2, X3 = _bilinear(corners[1], i, j)
            H0, H1, H2, H3 = _bilinear(corners[2], i, j)
            if not _unfolded(X1, X2, X3, Y1, Y2, Y3):
                continue
            _bounds(corners[0], corners[1], i, j, height.shape, box)
            for m in range(box[0], box[1]):
                for n in range(box[2], box[3]):
                    mu, nu = _inside(X0 - n, X1, X2, X3, Y0 - m, Y1, Y2, Y3)
                    if np.isnan(mu):
                        continue
                    h = H0 + H1 * mu + H2 * nu + H3 * mu * nu
                    k = sharing[m, n]
                    if k > 0 and h < height[m, n] - same_height:
                        continue
                    if k > 0 and h > height[m, n] + same_height:
                        k = 0
                    Xm, Xn = X1 + X3 * nu, X2 + X3 * mu
                    Ym, Yn = Y1 + Y3 * nu, Y2 + Y3 * mu
                    Hm, Hn = H1 + H3 * nu, H2 + H3 * mu
                    determinant = Xn * Ym - Yn * Xm
                    tx = (Hn * Ym - Yn * Hm) / determinant
                    ty = -(Hn * Xm - Xn * Hm) / determinant
                    if k == 0:
                        height[m, n], slope_x[m, n], slope_y[m, n] = h, tx, ty
                        A0, A1, A2, A3 = _bilinear(albedo, i, j)
                        albedo_out[m, n] = A0 + A1 * mu + A2 * nu + A3 * mu * nu
                        S0, S1, S2, S3 = _bilinear(sigma, i, j)
                        sigma_out[m, n] = S0 + S1 * mu + S2 * nu + S3 * mu * nu
                    else:
                        slope_x[m, n] += (tx - slope_x[m, n]) / (k + 1)
                        slope_y[m, n] += (ty - slope_y[m, n]) / (k + 1)
                    sharing[m, n] = k + 1


@compiled
def _bilinear(b: FloatArray, i: int, j: int) -> tuple[float, float, float, float]:
    """Coefficients of eq. 25 in the cell (i, j): 1, μ (along rows), ν (along columns), μν."""
    corner, up, right = b[i, j], b[i + 1, j], b[i, j + 1]
    return corner, up - corner, right - corner, b[i + 1, j + 1] - up - right + corner


@compiled
def _unfolded(X1: float, X2: float, X3: float, Y1: float, Y2: float, Y3: float) -> bool:
    """Whether the determinant of eqs. 30 and 31 is positive all over a cell.

    It is linear in μ and in ν, so that the four corners decide; NaN is not positive. A cell
    seen edge-on has a determinant of rounding errors, which counts as zero.
    """
    edge_on = 1e-12 * (X1 * X1 + X2 * X2 + X3 * X3 + Y1 * Y1 + Y2 * Y2 + Y3 * Y3)
    for mu in range(2):
        for nu in range(2):
            if not (X2 + X3 * mu) * (Y1 + Y3 * nu) - (Y2 + Y3 * mu) * (X1 + X3 * nu) > edge_on:
                return False
    return True


@compiled
def _bounds(
    row: FloatArray, column: FloatArray, i: int, j: int, shape: tuple[int, int], box: IntArray
) -> None:
    """Store the half-open ranges of grid rows and columns around the cell (i, j) in `box`."""
    for axis in range(2):
        b = row if axis == 0 else column
        low = min(b[i, j], b[i + 1, j], b[i, j + 1], b[i + 1, j + 1])
        high = max(b[i, j], b[i + 1, j], b[i, j + 1], b[i + 1, j + 1])
        box[2 * axis] = max(0, int(np.ceil(low - _BORDER)))
        box[2 * axis + 1] = min(shape[axis], int(np.floor(high + _BORDER)) + 1)


@compiled
def _inside(
    X0: float,
    X1: float,
    X2: float,
    X3: float,
    Y0: float,
    Y1: float,
    Y2: float,
    Y3: float,
) -> tuple[float, float]:
    """Solve eq. 26 for (μ, ν) by Newton's method; NaN if the point lies outside the cell."""
    mu, nu = 0.5, 0.5
    for _ in range(30):
        x = X0 + X1 * mu + X2 * nu + X3 * mu * nu
        y = Y0 + Y1 * mu + Y2 * nu + Y3 * mu * nu
        Xm, Xn, Ym, Yn = X1 + X3 * nu, X2 + X3 * mu, Y1 + Y3 * nu, Y2 + Y3 * mu
        determinant = Xn * Ym - Yn * Xm
        if determinant == 0:
            return np.nan, np.nan
        d_mu = (Yn * x - Xn * y) / determinant
        d_nu = (Xm * y - Ym * x) / determinant
        mu += d_mu
        nu += d_nu
        # Newton squares the error: the step after one of 1e-8 would be below rounding.
        if abs(d_mu) + abs(d_nu) < 1e-8 or abs(mu) + abs(nu) > 100.0:
            break
    if -_BORDER <= mu <= 1 + _BORDER and -_BORDER <= nu <= 1 + _BORDER:
        return mu, nu
    return np.nan, np.nan
