"""Surfaces as functions of direction, in cells of similar size around the body's centre."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline


@dataclass(frozen=True, eq=False)
class Directions:
    """A surface in the K cells of direction that have a point of it.

    The faces of a cube about the origin are cut into n × n cells each, about 90°/n wide.

    Attributes
    ----------
    n : int
    cell : (K,) int64 ndarray
        Numbers of the cells, below 6 n².
    row : (K,) int64 ndarray
        Index of the point of median distance from the origin in each.
    log_radius : (K,) ndarray
        Natural logarithm of that distance, metres.
    unit : (K, 3) ndarray
        Mean direction of the points in each cell.
    """

    n: int
    cell: IntArray
    row: IntArray
    log_radius: FloatArray
    unit: FloatArray

    @classmethod
    def of(cls, points: FloatArray, n: int) -> Directions:
        """Sort points (N, 3) into cells; points at the origin have no cell."""
        radius = np.sqrt(np.einsum("ij,ij->i", points, points))
        known = np.flatnonzero(radius > 0.0)
        cell = cells_of(points[known], n)
        order = np.lexsort((radius[known], cell))
        cell, known = cell[order], known[order]
        first = np.flatnonzero(np.diff(cell, prepend=-1))
        count = np.diff(first, append=len(cell))
        row = known[first + count // 2]
        unit = points[known] / radius[known, None]
        mean = np.add.reduceat(unit, first, axis=0) if len(first) else np.empty((0, 3))
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        return cls(n, cell[first], row, np.log(radius[row]), mean)

    def __len__(self) -> int:
        return len(self.cell)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the directions."""
        return cKDTree(self.unit)

    def coarser(self, n: int) -> Directions:
        """Return the same surface in larger cells."""
        return Directions.of(self.unit * np.exp(self.log_radius)[:, None], n)

    def smoothed(self, at: FloatArray, sigma_deg: float) -> FloatArray:
        """Return Gaussian means (M,) of the log radius about directions (M, 3).

        NaN where no cell lies within twice the standard deviation `sigma_deg`, degrees.
        """
        sigma = np.radians(sigma_deg)
        pairs = cKDTree(at).sparse_distance_matrix(self.tree, 2.0 * sigma, output_type="coo_matrix")
        weight = np.exp(-0.5 * (pairs.data / sigma) ** 2)
        matrix = sparse.csr_matrix((weight, (pairs.row, pairs.col)), shape=pairs.shape)
        total = np.asarray(matrix.sum(axis=1)).ravel()
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (matrix @ self.log_radius) / total
        return np.asarray(mean, dtype=np.float64)


def cell_centers(n: int) -> FloatArray:
    """Return the directions (6 n², 3) of the middles of all cells."""
    middle = _middles(n)
    v, u = np.repeat(middle, n), np.tile(middle, n)
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            face = np.full((n * n, 3), sign)
            face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = u, v
            faces.append(face)
    centers = np.concatenate(faces)
    centers /= np.linalg.norm(centers, axis=1, keepdims=True)
    return centers


@compiled_inline
def _spread(tangent: float) -> float:
    # A cheap approximation of 4/π arctan, which makes cells of similar size.
    square = tangent * tangent
    return tangent * (1.26 + square * (0.05 * square - 0.31))


@compiled_inline
def cell_of(x: float, y: float, z: float, n: int) -> int:
    """Return the number of the cell of a direction, a vector of any length."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, high, u, v = 0, x, y / ax, z / ax
    elif ay >= az:
        face, high, u, v = 2, y, z / ay, x / ay
    else:
        face, high, u, v = 4, z, x / az, y / az
    if high < 0.0:
        face += 1
    column = min(int((_spread(u) + 1.0) * 0.5 * n), n - 1)
    row = min(int((_spread(v) + 1.0) * 0.5 * n), n - 1)
    return (face * n + row) * n + column


@compiled
def _middles(n: int) -> FloatArray:
    """Tangents (n,) of the middles of the cells along a face."""
    middle = np.empty(n)
    for k in range(n):
        low, high = -1.0, 1.0
        for _ in range(40):
            between = 0.5 * (low + high)
            if _spread(between) < (2.0 * k + 1.0) / n - 1.0:
                low = between
            else:
                high = between
        middle[k] = 0.5 * (low + high)
    return middle


@compiled
def cells_of(points: FloatArray, n: int) -> IntArray:
    """Return the cells (N,) in which points (N, 3) lie.

    Parameters
    ----------
    points : (N, 3) ndarray
        Directions.
    n : int
        Cells along the side of a cube's face.
    """
    cells = np.empty(len(points), dtype=np.int64)
    for k in range(len(points)):
        cells[k] = cell_of(points[k, 0], points[k, 1], points[k, 2], n)
    return cells
