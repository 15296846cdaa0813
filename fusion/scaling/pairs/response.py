"""Response of a match of two surfaces to displacements that vary over the surface."""

from __future__ import annotations

import numpy as np

from fusion.surfacematch import accurate_variance
from spcola.arrays import AnyArray, FloatArray
from spcola.grids import Maplet, MapletGrid


def cell_means(grid: MapletGrid, points: FloatArray, values: FloatArray) -> FloatArray:
    """Mean (2q+1, 2q+1, S) of `values` (P, S) at `points` (P, 3) in each cell.

    NaN in cells without points; points outside the grid are ignored.
    """
    q, size = grid.half_size, 2 * grid.half_size + 1
    x, y, _ = grid.project(points)
    m, n = (np.rint(each).astype(np.intp) + q for each in (y, x))
    inside = (m >= 0) & (m < size) & (n >= 0) & (n < size)
    cell = m[inside] * size + n[inside]
    count = np.bincount(cell, minlength=size * size)
    sums = [np.bincount(cell, column, minlength=size * size) for column in values[inside].T]
    with np.errstate(invalid="ignore", divide="ignore"):
        means: FloatArray = np.array(sums).reshape(-1, size * size).T / count[:, None]
    return means.reshape(size, size, -1)


def match_response(spc: Maplet, points: FloatArray, shares: FloatArray) -> FloatArray:
    """Response (S, 3, 3) of the match of returns to a bigmap; see :func:`surface_response`.

    Parameters
    ----------
    spc : Maplet
        The SPC bigmap.
    points : (P, 3) ndarray
        The returns, body-fixed, metres.
    shares : (P, S) ndarray
        Share of each of S sources in the position of each return.
    """
    cells = cell_means(spc.grid, points, shares)
    return surface_response(spc.grid, spc.height, spc.sigma**2, cells)


def surface_response(
    grid: MapletGrid, height: FloatArray, variance: FloatArray, shares: FloatArray
) -> FloatArray:
    """Displacement of a match per metre of displacement of single sources.

    A match fits a displacement and a plane to differences of heights (docs: derivations §13). A
    source that displaces the points of a cell by its share s of u changes the height there by
    s (−∂h/∂x, −∂h/∂y, 1)·u, and the fitted displacement and plane by

        H⁻¹ Σ w g s gᵀ,   g = (−∂h/∂x, −∂h/∂y, 1, x, y),   H = Σ w g gᵀ

    of which the first three rows and columns are returned. If s is the same everywhere this is s
    itself; a source that affects one end of the square also bends the surface.

    Parameters
    ----------
    grid : MapletGrid
    height : (2q+1, 2q+1) ndarray
        Of the surface, metres, at the resolution of the match; NaN where unknown.
    variance : (2q+1, 2q+1) ndarray
        Of the differences, m²; only ratios matter.
    shares : (2q+1, 2q+1, S) ndarray
        Share of each of S sources in the points of each cell; NaN without points.

    Returns
    -------
    (S, 3, 3) ndarray
        Body-fixed: displacement of the match = response @ u. The mean share times the unit matrix
        if the relief does not determine a match.
    """
    slope_y, slope_x = np.gradient(height, grid.gsd)
    y, x = np.meshgrid(grid.offsets, grid.offsets, indexing="ij")
    columns = [-slope_x, -slope_y, np.ones(height.shape), x / grid.size, y / grid.size]
    partials = np.stack(columns, axis=2)
    used = np.isfinite(partials).all(axis=2) & np.isfinite(shares).all(axis=2)
    g, s = partials[used], shares[used]
    weighted = g * _weights(variance[used])[:, None]
    normal = weighted.T @ g
    if len(g) < 30 or np.linalg.cond(normal) > 1e10:
        mean = s.mean(axis=0) if len(s) else np.zeros(shares.shape[2])
        return mean[:, None, None] * np.eye(3)
    right = np.einsum("pi,ps,pj->sij", weighted, s, g[:, :3], optimize=True)
    local = np.linalg.solve(normal, right)[:, :3]
    return np.einsum("ia,sij,jb->sab", grid.axes, local, grid.axes, optimize=True)


def _weights(variance: FloatArray) -> AnyArray:
    """Inverse variances (P,), equal for the most accurate points; 1 if none is known."""
    known = variance[np.isfinite(variance) & (variance > 0)]
    if not known.size:
        return np.ones(len(variance))
    filled = np.where(np.isfinite(variance) & (variance > 0), variance, np.median(known))
    return 1.0 / np.maximum(filled, accurate_variance(filled))
