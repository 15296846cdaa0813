"""How a match of two surfaces follows displacements that are not the same all over them."""

from __future__ import annotations

import numpy as np

from fusion.surfacematch import BEST_SHARE
from spcola.arrays import AnyArray, FloatArray
from spcola.grids import MapletGrid


def cell_means(grid: MapletGrid, points: FloatArray, values: FloatArray) -> FloatArray:
    """Mean (2q+1, 2q+1, S) of what `values` (P, S) say at `points` (P, 3), cell by cell.

    NaN in cells that no point lies in; points beside the grid are passed over.
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


def match_response(
    grid: MapletGrid, height: FloatArray, variance: FloatArray, shares: FloatArray
) -> FloatArray:
    """Displacement that a match reports for displacements of single sources, per metre.

    A match fits a displacement and a plane to differences of heights (docs: derivations §13). A
    source that displaces the points of a cell by its share s of u changes the height there by
    s (−∂h/∂x, −∂h/∂y, 1)·u, and the match by what is left of that beside the plane:

        H⁻¹ Σ w g s gᵀ,   g = (−∂h/∂x, −∂h/∂y, 1, x, y),   H = Σ w g gᵀ

    of which the first three rows and columns count. Where s is the same everywhere that is s
    itself; a source that leans on one end of the square only bends it beside.

    Parameters
    ----------
    grid : MapletGrid
    height : (2q+1, 2q+1) ndarray
        Of the surface, metres, at the resolution of the match; NaN where unknown.
    variance : (2q+1, 2q+1) ndarray
        Of the differences, m²; only how points compare matters.
    shares : (2q+1, 2q+1, S) ndarray
        Share of each of S sources in the points of each cell; NaN where there are none.

    Returns
    -------
    (S, 3, 3) ndarray
        Body-fixed: reported = response @ u. The mean share times the unit matrix where the
        relief does not hold a match.
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
    felt = np.einsum("pi,ps,pj->sij", weighted, s, g[:, :3], optimize=True)
    local = np.linalg.solve(normal, felt)[:, :3]
    return np.einsum("ia,sij,jb->sab", grid.axes, local, grid.axes, optimize=True)


def _weights(variance: FloatArray) -> AnyArray:
    """Inverse variances (P,), those of the points known best alike; 1 where none is known."""
    known = variance[np.isfinite(variance) & (variance > 0)]
    if not known.size:
        return np.ones(len(variance))
    filled = np.where(np.isfinite(variance) & (variance > 0), variance, np.median(known))
    return 1.0 / np.maximum(filled, np.quantile(filled, BEST_SHARE))
