"""The normal matrix of a height problem, and its sparse factors for problems that resist."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from spcola.arrays import FloatArray
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


class DirectSolver:
    """Sparse factors of the normal matrix; one point of each floating part is held.

    For problems whose weights jump so wildly that 2 × 2 aggregates do not describe them. Costs
    far more memory than multigrid, so that it is for grids of some hundred thousand points.
    """

    def __init__(self, problem: HeightProblem, weight: FloatArray, components: Components) -> None:
        self._mask = problem.mask
        labels = components.labels
        held = np.array(weight)
        _, first = np.unique(labels, return_index=True)
        inside = np.unique(labels)
        for label, index in zip(inside, first, strict=True):
            if label >= 0 and components.weight[label] == 0:
                held.flat[index] = 1.0
        self._factors = splu(
            normal_matrix(problem, held),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def apply(self, residual: FloatArray, unit: float, answer: FloatArray) -> None:
        """Store in `answer` the heights that `residual` times `unit` asks for (both padded)."""
        right = unit * residual[1:-1, 1:-1][self._mask].astype(np.float64)
        answer[1:-1, 1:-1][self._mask] = self._factors.solve(right)
