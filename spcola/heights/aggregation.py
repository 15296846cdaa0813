"""Multigrid over aggregates that follow the strong edges, for weights that 2 × 2 squares miss.

Points are paired with a neighbour that holds them most strongly, once for each level (pairs of
pairs would move stiff pairs that the smoother, point by point, cannot); what lies side by side
without holding together (the arms of a spiral, two stiff pieces with a soft joint between) is
never merged. Each coarse problem is solved by at most two steps of flexible conjugate gradients
(the K-cycle of Notay, ETNA 37, 2010), which find the right scale of the correction themselves,
whatever the shape of the aggregates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel

_COARSEST_POINTS = 2000
"""Points of the level that is left to sparse factors."""
_SLOWEST = 0.8
"""Share of points that coarsening may leave; a graph that resists is left to the factors."""
_STRONG = 4.0
"""How much weaker than the strongest edges of its two points the edge of a pair may be."""
_ENOUGH = 0.25
"""Fall of a coarse residual after which a second step is not worth its time (Notay)."""
_REDUCTION = 1e-9
"""Fall of the error (in the norm of the energy) at which a solution counts as the solution."""
_MOST_STEPS = 200


@dataclass(frozen=True, eq=False)
class _Level:
    """A matrix, one over its diagonal, and the aggregate that each point belongs to."""

    matrix: csr_array
    inverse: FloatArray
    aggregate: IntArray
    coarse: int

    def sweep(self, x: FloatArray, b: FloatArray, *, backward: bool) -> None:
        """Gauss–Seidel over all points, in place."""
        m = self.matrix
        _sweep(m.indptr, m.indices, m.data, self.inverse, x, b, backward)


class AggregationSolver:
    """Solve ``A x = b`` for a sparse matrix of the kind that height problems have.

    Parameters
    ----------
    matrix : csc_array (n, n)
        Symmetric and positive definite.
    """

    def __init__(self, matrix: csc_array) -> None:
        self._levels: list[_Level] = []
        fine: csr_array = matrix.tocsr()
        while fine.shape[0] > _COARSEST_POINTS:
            aggregate = _pairs(fine)
            count = int(aggregate.max()) + 1
            if count > _SLOWEST * fine.shape[0]:
                break
            self._levels.append(_Level(fine, 1.0 / fine.diagonal(), aggregate, count))
            fine = _merged(fine, aggregate)
        self._factors: Any = splu(
            fine.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def solve(self, right: FloatArray) -> tuple[FloatArray, int]:
        """Return the solution and the number of cycles."""
        if not self._levels:
            answer: FloatArray = self._factors.solve(right)
            return answer, 1
        matrix = self._levels[0].matrix
        x, r = np.zeros_like(right), right.copy()
        z = self._cycle(0, r)
        p, rz = z, float(r @ z)
        enough = _REDUCTION**2 * rz
        done = 0
        while rz > enough and done < _MOST_STEPS:
            q = matrix @ p
            alpha = float(p @ r) / float(p @ q)
            x += alpha * p
            r -= alpha * q
            z = self._cycle(0, r)
            rz = float(r @ z)
            # The cycle is not linear, so that directions are made conjugate explicitly.
            p = z - (float(z @ q) / float(p @ q)) * p
            done += 1
        return x, done

    def _cycle(self, k: int, b: FloatArray) -> FloatArray:
        level = self._levels[k]
        x = np.zeros_like(b)
        level.sweep(x, b, backward=False)
        rest = np.zeros(level.coarse)
        np.add.at(rest, level.aggregate, b - level.matrix @ x)
        x += self._correction(k + 1, rest)[level.aggregate]
        level.sweep(x, b, backward=True)
        return x

    def _correction(self, k: int, b: FloatArray) -> FloatArray:
        """Solve level `k` for `b` by at most two steps of flexible conjugate gradients."""
        if k == len(self._levels):
            answer: FloatArray = self._factors.solve(b)
            return answer
        matrix = self._levels[k].matrix
        c = self._cycle(k, b)
        v = matrix @ c
        energy = float(c @ v)
        if energy <= 0:
            return c
        first = float(c @ b) / energy
        rest = b - first * v
        if rest @ rest <= _ENOUGH**2 * (b @ b):
            return first * c
        d = self._cycle(k, rest)
        w = matrix @ d
        mixed = float(d @ v)
        left = float(d @ w) - mixed**2 / energy
        if left <= 0:
            return first * c
        second = float(d @ rest) / left
        return (first - mixed / energy * second) * c + second * d


def _merged(matrix: csr_array, aggregate: IntArray) -> csr_array:
    """Return the matrix of the aggregates, ``PᵀAP``."""
    count, points = int(aggregate.max()) + 1, len(aggregate)
    entries = (np.ones(points), aggregate, np.arange(points + 1))
    prolongation = csr_array(entries, shape=(points, count))
    merged: csr_array = (prolongation.T @ matrix @ prolongation).tocsr()
    return merged


def _pairs(matrix: csr_array) -> IntArray:
    aggregate = np.full(matrix.shape[0], -1, dtype=np.int32)
    _pair(matrix.indptr, matrix.indices, matrix.data, aggregate)
    return aggregate


@kernel
def _pair(indptr: IntArray, indices: IntArray, data: FloatArray, aggregate: IntArray) -> None:
    """Pair points by edges that are strong for both; the others join where they are held most."""
    points = len(aggregate)
    hold, strongest = np.zeros(points), np.arange(points)
    for i in range(points):
        for n in range(indptr[i], indptr[i + 1]):
            if indices[n] != i and -data[n] > hold[i]:
                hold[i], strongest[i] = -data[n], indices[n]
    count = 0
    for i in range(points):
        if aggregate[i] >= 0:
            continue
        partner, most = -1, 0.0
        for n in range(indptr[i], indptr[i + 1]):
            j = indices[n]
            strong = -_STRONG * data[n]
            mutual = strong >= hold[i] and strong >= hold[j] > 0
            if j != i and aggregate[j] < 0 and mutual and -data[n] > most:
                partner, most = j, -data[n]
        if partner >= 0:
            aggregate[i] = aggregate[partner] = count
            count += 1
    for i in range(points):
        j = i
        # Each next edge is at least as strong, and the strongest of all has found its pair.
        while aggregate[j] < 0 and strongest[j] != j:
            j = strongest[j]
        if aggregate[j] < 0:
            aggregate[j] = count
            count += 1
        aggregate[i] = aggregate[j]


@kernel
def _sweep(
    indptr: IntArray,
    indices: IntArray,
    data: FloatArray,
    inverse: FloatArray,
    x: FloatArray,
    b: FloatArray,
    backward: bool,
) -> None:
    points = len(x)
    for step in range(points):
        i = points - 1 - step if backward else step
        rest = b[i]
        for n in range(indptr[i], indptr[i + 1]):
            rest -= data[n] * x[indices[n]]
        x[i] += rest * inverse[i]
