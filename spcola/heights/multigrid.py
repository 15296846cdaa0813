"""A multigrid cycle for energy (A), used as the preconditioner of conjugate gradients.

Each level aggregates 2 × 2 points of the finer one. With the piecewise-constant prolongation P,
the exact coarse matrix of the steps, ``PᵀLP``, is twice as stiff to smooth surfaces as it
should be, so the coarse edges are *halved*; the constraints are only summed, so that constants
are carried exactly.

Why the cycle is always positive definite, whatever weights, holes and islands: the coarse
matrix is at least ½ PᵀAP, so an exact coarse correction has eigenvalues in [0, 2] (in the energy
norm) and never makes an error grow; the smoothing before and after makes every error shrink
strictly; and two such cycles in a row on the coarser level (the W) have eigenvalues in (0, 1]
of the exact coarse solution again. A V-cycle would not have this property.

All levels lie in flat arrays, each level padded by a frame of points without edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.heights.problem import HeightProblem
from spcola.kernel import kernel


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Coefficients of all levels; level l is ``[start[l] : start[l + 1]]``, padded (R+2, C+2).

    Parameters
    ----------
    sizes : (levels, 2) integer ndarray
        Rows and columns of each level, without the frame.
    start : (levels + 1,) integer ndarray
        Where each level begins in the flat arrays.
    right, down : (n,) ndarrays
        Weight of the edge to the next column and to the next row, 1/m².
    ground : (n,) ndarray
        Weight of the constraint, 1/m².
    inverse : (n,) ndarray
        One over the diagonal, m²; 0 where the diagonal is 0.
    """

    sizes: IntArray
    start: IntArray
    right: FloatArray
    down: FloatArray
    ground: FloatArray
    inverse: FloatArray

    @property
    def padded_shape(self) -> tuple[int, int]:
        """Shape of the finest level with its frame."""
        return (int(self.sizes[0, 0]) + 2, int(self.sizes[0, 1]) + 2)

    def finest(self, values: FloatArray) -> FloatArray:
        """Return the finest level of a flat array as a padded (R + 2, C + 2) view."""
        return values[: self.start[1]].reshape(self.padded_shape)


def build_hierarchy(problem: HeightProblem, weight: FloatArray) -> Hierarchy:
    """Build all levels of `problem` with constraint weights `weight` (R, C), 1/m²."""
    sizes = [problem.shape]
    while max(sizes[-1]) > 1:
        rows, columns = sizes[-1]
        sizes.append(((rows + 1) // 2, (columns + 1) // 2))
    padded = [(rows + 2) * (columns + 2) for rows, columns in sizes]
    start = np.concatenate([[0], np.cumsum(padded)]).astype(np.int64)
    right, down, ground = (np.zeros(start[-1]) for _ in range(3))
    fine = slice(0, int(start[1]))
    shape = (problem.shape[0] + 2, problem.shape[1] + 2)
    right[fine].reshape(shape)[1:-1, 1:-2] = problem.weight_x
    down[fine].reshape(shape)[1:-2, 1:-1] = problem.weight_y
    ground[fine].reshape(shape)[1:-1, 1:-1] = weight
    inverse = np.zeros(start[-1])
    table = np.array(sizes, dtype=np.int64)
    _coarsen_all(table, start, right, down, ground, inverse)
    return Hierarchy(table, start, right, down, ground, inverse)


class Multigrid:
    """One W-cycle of a hierarchy, with the scratch memory that it needs.

    Not to be shared between threads.
    """

    def __init__(self, hierarchy: Hierarchy) -> None:
        self.hierarchy = hierarchy
        self._value = np.zeros(hierarchy.start[-1])
        self._source = np.zeros(hierarchy.start[-1])

    def apply(self, residual: FloatArray) -> FloatArray:
        """Return the cycle's answer (R + 2, C + 2) to `residual` of the same padded shape.

        The answer is a view of the scratch memory, overwritten by the next call.
        """
        levels = self.hierarchy
        levels.finest(self._source)[...] = residual
        levels.finest(self._value)[...] = 0.0
        _cycle(
            0,
            levels.sizes,
            levels.start,
            levels.right,
            levels.down,
            levels.ground,
            levels.inverse,
            self._value,
            self._source,
        )
        return levels.finest(self._value)


@kernel
def _coarsen_all(
    sizes: IntArray,
    start: IntArray,
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    inverse: FloatArray,
) -> None:
    """Fill all coarser levels from the finest one, and the inverse diagonals."""
    for level in range(len(sizes)):
        rows, columns = sizes[level]
        span = slice(start[level], start[level + 1])
        shape = (rows + 2, columns + 2)
        e, s, g = right[span].reshape(shape), down[span].reshape(shape), ground[span].reshape(shape)
        d = inverse[span].reshape(shape)
        for i in range(1, rows + 1):
            for j in range(1, columns + 1):
                diagonal = e[i, j] + e[i, j - 1] + s[i, j] + s[i - 1, j] + g[i, j]
                d[i, j] = 1.0 / diagonal if diagonal > 0 else 0.0
        if level + 1 == len(sizes):
            return
        shape = (sizes[level + 1, 0] + 2, sizes[level + 1, 1] + 2)
        span = slice(start[level + 1], start[level + 2])
        E, S, G = right[span].reshape(shape), down[span].reshape(shape), ground[span].reshape(shape)
        for i in range(1, rows + 1):
            I = (i + 1) // 2  # noqa: E741  the coarse index, as i is the fine one
            for j in range(1, columns + 1):
                J = (j + 1) // 2
                G[I, J] += g[i, j]
                if j % 2 == 0:
                    E[I, J] += 0.5 * e[i, j]
                if i % 2 == 0:
                    S[I, J] += 0.5 * s[i, j]


@kernel
def _cycle(  # noqa: PLR0913, PLR0917  flat arrays of all levels, because it calls itself
    level: int,
    sizes: IntArray,
    start: IntArray,
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    inverse: FloatArray,
    value: FloatArray,
    source: FloatArray,
) -> None:
    """Improve `value` of `level` by one W-cycle toward the solution for `source`."""
    shape = (sizes[level, 0] + 2, sizes[level, 1] + 2)
    span = slice(start[level], start[level + 1])
    e, s, g = right[span].reshape(shape), down[span].reshape(shape), ground[span].reshape(shape)
    d = inverse[span].reshape(shape)
    x, b = value[span].reshape(shape), source[span].reshape(shape)
    if level + 1 == len(sizes):
        x[1, 1] = b[1, 1] * d[1, 1]
        return
    _smooth(e, s, d, x, b, 0)
    shape = (sizes[level + 1, 0] + 2, sizes[level + 1, 1] + 2)
    span = slice(start[level + 1], start[level + 2])
    X, B = value[span].reshape(shape), source[span].reshape(shape)
    X[:] = 0.0
    _restrict_residual(e, s, g, x, b, B)
    for _ in range(2):
        _cycle(level + 1, sizes, start, right, down, ground, inverse, value, source)
    for i in range(1, shape[0] - 1):
        for k in range(2 * i - 1, min(2 * i, x.shape[0] - 2) + 1):
            for j in range(1, x.shape[1] - 1):
                if d[k, j] > 0:
                    x[k, j] += X[i, (j + 1) // 2]
    _smooth(e, s, d, x, b, 1)


@kernel
def _smooth(
    e: FloatArray, s: FloatArray, d: FloatArray, x: FloatArray, b: FloatArray, first: int
) -> None:
    """Gauss–Seidel over one colour, then the other; `first` 0: red (i + j even) first.

    The second colour follows one row behind the first, so that memory is read once.
    """
    rows, columns = x.shape[0] - 2, x.shape[1] - 2
    for leading in range(1, rows + 2):
        for i, colour in ((leading, first), (leading - 1, 1 - first)):
            if 1 <= i <= rows:
                for j in range(1 + (i + 1 + colour) % 2, columns + 1, 2):
                    x[i, j] = d[i, j] * (
                        b[i, j]
                        + e[i, j] * x[i, j + 1]
                        + e[i, j - 1] * x[i, j - 1]
                        + s[i, j] * x[i + 1, j]
                        + s[i - 1, j] * x[i - 1, j]
                    )


@kernel
def _restrict_residual(
    e: FloatArray, s: FloatArray, g: FloatArray, x: FloatArray, b: FloatArray, B: FloatArray
) -> None:
    """Sum the residual ``b − A x`` over the aggregates into `B`."""
    B[:] = 0.0
    for i in range(1, x.shape[0] - 1):
        row = B[(i + 1) // 2]
        for j in range(1, x.shape[1] - 1):
            here = x[i, j]
            row[(j + 1) // 2] += (
                b[i, j]
                - g[i, j] * here
                - e[i, j] * (here - x[i, j + 1])
                - e[i, j - 1] * (here - x[i, j - 1])
                - s[i, j] * (here - x[i + 1, j])
                - s[i - 1, j] * (here - x[i - 1, j])
            )
