"""The normal matrix of a height problem, and multigrid on it for irregular problems."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array

from spcola.arrays import FloatArray
from spcola.heights.aggregation import AggregationCycle
from spcola.heights.components import Components
from spcola.heights.problem import HeightProblem


def normal_matrix(problem: HeightProblem, weight: FloatArray) -> csc_array:
    """Return ``L + W`` (and the means) over the points of the mask, in row order (n, n), 1/m².

    `weight` (R, C) are the constraint weights, 1/m².
    """
    number = np.full(problem.shape, -1, dtype=np.int32)
    count = int(np.count_nonzero(problem.mask))
    number[problem.mask] = np.arange(count, dtype=np.int32)
    joined_x, joined_y = problem.weight_x > 0, problem.weight_y > 0
    a = np.concatenate([number[:, :-1][joined_x], number[:-1][joined_y]])
    b = np.concatenate([number[:, 1:][joined_x], number[1:][joined_y]])
    w = np.concatenate([problem.weight_x[joined_x], problem.weight_y[joined_y]])
    own = np.arange(count, dtype=np.int32)
    matrix: csc_array = coo_array(
        (
            np.concatenate([w, w, -w, -w, weight[problem.mask]]),
            (np.concatenate([a, b, a, b, own]), np.concatenate([a, b, b, a, own])),
        ),
        shape=(count, count),
    ).tocsc()
    if problem.means is not None:
        means = problem.means
        root = np.sqrt(means.weight)[means.owner] * means.share
        entries = (means.owner, number.ravel()[means.points])
        rows = coo_array((root, entries), shape=(len(means.height), count)).tocsr()
        matrix = (matrix + rows.T @ rows).tocsc()
    return matrix


class GraphCycle:
    """Multigrid on the normal matrix as a graph; one point of each floating part is fixed.

    For problems whose weights jump too much, or whose masks are too thin, for 2 × 2 aggregates.
    Costs several times the memory and time of the multigrid on squares.
    """

    def __init__(self, problem: HeightProblem, weight: FloatArray, components: Components) -> None:
        self._mask = problem.mask
        labels = components.labels
        ground = np.array(weight)
        _, first = np.unique(labels, return_index=True)
        inside = np.unique(labels)
        for label, index in zip(inside, first, strict=True):
            if label >= 0 and components.weight[label] == 0:
                ground.flat[index] = 1.0
        self._cycle = AggregationCycle(normal_matrix(problem, ground))

    def apply(self, residual: FloatArray, unit: float, response: FloatArray) -> None:
        """Store in `response` the height change for `residual` times `unit` (both padded)."""
        right = unit * residual[1:-1, 1:-1][self._mask].astype(np.float64)
        response[1:-1, 1:-1][self._mask] = self._cycle.apply(right)
