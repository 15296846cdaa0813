"""Multigrid over aggregates that follow the strong edges, where 2 × 2 squares do not converge.

Each point is paired with the neighbour of the strongest edge, once per level (pairs of pairs would
move stiff pairs that the smoother, point by point, cannot). Neighbours without a strong edge (the
arms of a spiral, two stiff pieces with a soft joint between) are never merged. Points whose own
constraint exceeds their edges are left to the smoother, because an aggregate that contains one
would be constrained as firmly (Napov & Notay, SIAM J. Sci. Comput. 34, 2012). Each coarse problem
is solved by at most two steps of flexible conjugate gradients (the K-cycle of Notay, ETNA 37,
2010), which find the right scale of the correction, whatever the shape of the aggregates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled

Graph = tuple[IntArray, IntArray, FloatArray]
"""A sparse matrix by rows: `indptr`, `indices` and `data` of a ``csr_array``."""

_COARSEST_POINTS = 2000
"""Points of the level that is solved by sparse factors."""
_SLOWEST = 0.8
"""Share of points that coarsening may leave; otherwise the factors solve the level."""
_STRONG = 4.0
"""Smallest weight of a pair's edge, relative to the strongest edges of its two points."""
_CONSTRAINED = 1.0 / 3.0
"""Constraint of a point, over the sum of its edges, above which only the smoother moves it: that
of Napov & Notay for a condition number of 8; by experiment a tenth is too little."""
_SMALLER = 2.5
"""Reduction of points from one level with a second step to the next such level: each visits all
levels below it twice, so with pairs alone (half the points) all levels would cost alike."""
_ADDED = 1e-2
"""Addition to the diagonal of a singular matrix, relative to it. By experiment, with a thousandth
the rounding along the undetermined direction already ends the iteration early."""
_ENOUGH = 0.25
"""Reduction of a coarse residual after which a second step is not worth its time (Notay)."""


@dataclass(frozen=True, eq=False)
class _Level:
    """A matrix as a graph, the inverse of its diagonal, and the aggregate of each point (or −1)."""

    graph: Graph
    inverse: FloatArray
    aggregate: IntArray
    coarse: int

    def sweep(self, x: FloatArray, b: FloatArray, *, backward: bool) -> None:
        """Gauss–Seidel over all points, in place."""
        _sweep(self.graph, self.inverse, x, b, backward)

    def restrict(self, x: FloatArray, b: FloatArray) -> FloatArray:
        """Return the sum of ``b − A x`` over each aggregate."""
        rest = np.zeros(self.coarse)
        _restrict(self.graph, x, b, self.aggregate, rest)
        return rest

    def multiply(self, x: FloatArray) -> tuple[FloatArray, float]:
        """Return ``A x`` and ``xᵀ A x``."""
        out = np.empty_like(x)
        return out, _multiply(self.graph, x, out)


class AggregationCycle:
    """One cycle on ``A x = b`` for the sparse matrix of a height problem.

    It is symmetric except for the inner steps, which depend on `b`: a preconditioner for *flexible*
    conjugate gradients.

    Parameters
    ----------
    matrix : csc_array (n, n)
        Symmetric and positive definite.
    """

    def __init__(self, matrix: csc_array) -> None:
        self._levels: list[_Level] = []
        self._twice: list[bool] = []
        fine: csr_array = matrix.tocsr()
        last = fine.shape[0]
        while fine.shape[0] > _COARSEST_POINTS:
            graph = (fine.indptr, fine.indices, fine.data)
            aggregate = np.full(fine.shape[0], -1, dtype=np.int32)
            count = _pair(graph, *_strengths(graph), aggregate)
            if count > _SLOWEST * fine.shape[0]:
                break
            self._levels.append(_Level(graph, 1.0 / fine.diagonal(), aggregate, count))
            fine = _merged(fine, aggregate, count)
            self._twice.append(count * _SMALLER <= last)
            last = count if self._twice[-1] else last
        self._factors: Any = _factored(fine) if fine.shape[0] > 0 else None

    def apply(self, right: FloatArray) -> FloatArray:
        """Return the cycle's response (n,) to `right` (n,)."""
        return self._response(0, right)

    def _response(self, k: int, b: FloatArray) -> FloatArray:
        """One cycle from level `k` down; the last level is solved, or has no points."""
        if k == len(self._levels):
            return b if self._factors is None else self._factors.solve(b)
        level = self._levels[k]
        x = np.zeros_like(b)
        level.sweep(x, b, backward=False)
        _spread(self._correction(k + 1, level.restrict(x, b)), level.aggregate, x)
        level.sweep(x, b, backward=True)
        return x

    def _correction(self, k: int, b: FloatArray) -> FloatArray:
        """Solve level `k` for `b` by at most two steps of flexible conjugate gradients."""
        c = self._response(k, b)
        if k == len(self._levels):
            return c
        level = self._levels[k]
        v, energy = level.multiply(c)
        if energy <= 0:
            return c
        first = _dot(c, b) / energy
        rest = b - first * v
        if not self._twice[k - 1] or _dot(rest, rest) <= _ENOUGH**2 * _dot(b, b):
            return first * c
        d = self._response(k, rest)
        _, own = level.multiply(d)
        mixed = _dot(d, v)
        left = own - mixed**2 / energy
        if left <= 0:
            return first * c
        second = _dot(d, rest) / left
        return (first - mixed / energy * second) * c + second * d


def _factored(matrix: csr_array) -> Any:
    """Return sparse factors of a matrix, or of one with a larger diagonal where it is singular.

    Two pieces that only a mean connects can move against each other without any energy. A
    preconditioner needs a finite response there, not an exact one.
    """
    options: dict[str, Any] = {
        "permc_spec": "MMD_AT_PLUS_A",
        "diag_pivot_thresh": 0.0,
        "options": {"SymmetricMode": True},
    }
    try:
        return splu(matrix.tocsc(), **options)
    except RuntimeError:
        return splu((matrix + diags_array(_ADDED * matrix.diagonal())).tocsc(), **options)


def _merged(matrix: csr_array, aggregate: IntArray, count: int) -> csr_array:
    """Return the matrix of the aggregates, ``PᵀAP``."""
    inside = aggregate >= 0
    start = np.concatenate([[0], np.cumsum(inside)])
    entries = (np.ones(start[-1]), aggregate[inside], start)
    prolongation = csr_array(entries, shape=(len(aggregate), count))
    return (prolongation.T @ matrix @ prolongation).tocsr()


@compiled
def _strengths(graph: Graph) -> tuple[FloatArray, IntArray, BoolArray]:
    """Return for each point its strongest edge, the neighbour there, and whether it is unpaired."""
    indptr, indices, data = graph
    points = len(indptr) - 1
    strength, strongest = np.zeros(points), np.arange(points)
    alone = np.zeros(points, dtype=np.bool_)
    for i in range(points):
        edges, ground = 0.0, 0.0
        for n in range(indptr[i], indptr[i + 1]):
            if indices[n] == i:
                ground += data[n]
                continue
            edges -= min(data[n], 0.0)
            ground -= abs(data[n])
            if -data[n] > strength[i]:
                strength[i], strongest[i] = -data[n], indices[n]
        alone[i] = ground >= _CONSTRAINED * edges
    return strength, strongest, alone


@compiled
def _pair(
    graph: Graph,
    strength: FloatArray,
    strongest: IntArray,
    alone: BoolArray,
    aggregate: IntArray,
) -> int:
    """Pair points by edges strong for both; the others join their strongest neighbour's pair."""
    indptr, indices, data = graph
    points, count = len(aggregate), 0
    for i in range(points):
        if aggregate[i] >= 0 or alone[i]:
            continue
        partner, most = -1, 0.0
        for n in range(indptr[i], indptr[i + 1]):
            j = indices[n]
            strong = -_STRONG * data[n]
            mutual = strong >= strength[i] and strong >= strength[j] > 0
            free = j != i and aggregate[j] < 0 and not alone[j]
            if free and mutual and -data[n] > most:
                partner, most = j, -data[n]
        if partner >= 0:
            aggregate[i] = aggregate[partner] = count
            count += 1
    for i in range(points):
        if alone[i]:
            continue
        j = i
        # Each next edge is at least as strong, and the strongest of all has found its pair.
        while aggregate[j] < 0 and strongest[j] != j and not alone[strongest[j]]:
            j = strongest[j]
        if aggregate[j] < 0:
            aggregate[j] = count
            count += 1
        aggregate[i] = aggregate[j]
    return count


@compiled
def _restrict(
    graph: Graph,
    x: FloatArray,
    b: FloatArray,
    aggregate: IntArray,
    out: FloatArray,
) -> None:
    indptr, indices, data = graph
    for i in range(len(x)):
        if aggregate[i] < 0:
            continue
        rest = b[i]
        for n in range(indptr[i], indptr[i + 1]):
            rest -= data[n] * x[indices[n]]
        out[aggregate[i]] += rest


@compiled
def _multiply(graph: Graph, x: FloatArray, out: FloatArray) -> float:
    indptr, indices, data = graph
    total = 0.0
    for i in range(len(x)):
        here = 0.0
        for n in range(indptr[i], indptr[i + 1]):
            here += data[n] * x[indices[n]]
        out[i] = here
        total += x[i] * here
    return total


@compiled
def _dot(one: FloatArray, other: FloatArray) -> float:
    """Return ``oneᵀ other`` on this thread: threads of BLAS would wait for one another here."""
    total = 0.0
    for i in range(len(one)):
        total += one[i] * other[i]
    return total


@compiled
def _spread(coarse: FloatArray, aggregate: IntArray, x: FloatArray) -> None:
    for i in range(len(x)):
        if aggregate[i] >= 0:
            x[i] += coarse[aggregate[i]]


@compiled
def _sweep(
    graph: Graph,
    inverse: FloatArray,
    x: FloatArray,
    b: FloatArray,
    backward: bool,
) -> None:
    indptr, indices, data = graph
    points = len(x)
    for step in range(points):
        i = points - 1 - step if backward else step
        rest = b[i]
        for n in range(indptr[i], indptr[i + 1]):
            rest -= data[n] * x[indices[n]]
        x[i] += rest * inverse[i]
