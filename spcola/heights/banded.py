"""Exact factors of small height problems: banded Cholesky and entries of the inverse."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled
from spcola.heights.components import find_components
from spcola.heights.means import Sets
from spcola.heights.problem import HeightProblem


class BandedFactor:
    """Cholesky factor of the normal matrix of `problem`, points numbered row by row.

    The band is as wide as a row, so that the work is (points × columns²): a maplet of 99 × 99
    takes a fraction of a second. Means over blocks of k rows widen it k − 1 times. Floating parts
    are fixed, and their variance is NaN.

    Parameters
    ----------
    problem : HeightProblem
        With finite weights; steps and heights do not matter.
    """

    def __init__(self, problem: HeightProblem) -> None:
        self._shape = problem.shape
        parts = find_components(problem)
        # Fixing the whole of a floating part makes the matrix regular; its results are NaN.
        self._unknown = parts.is_floating | ~problem.mask
        self._factor = cholesky_banded(
            _band(problem, np.where(self._unknown, 1.0, problem.weight)),
            lower=True,
            overwrite_ab=True,
            check_finite=False,
        )

    def variance(self) -> FloatArray:
        """Return the diagonal of the inverse (R, C), m²; NaN on floating parts and holes."""
        (diagonal,) = inverse_entries(np.ascontiguousarray(self._factor.T), np.array([0]))
        return np.where(self._unknown, np.nan, diagonal.reshape(self._shape))

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the heights (R, C, S) for right-hand sides (R, C, S)."""
        flat = right.reshape(-1, right.shape[-1])
        solution: FloatArray = cho_solve_banded((self._factor, True), flat, check_finite=False)
        return solution.reshape(right.shape)


def _band(problem: HeightProblem, ground: FloatArray) -> FloatArray:
    """Return the normal matrix in the lower banded form of LAPACK (columns + 1, points)."""
    rows, columns = problem.shape
    diagonal = np.array(ground)
    right, down = np.zeros((2, rows, columns))
    right[:, :-1], down[:-1] = problem.weight_x, problem.weight_y
    diagonal += right + down
    diagonal[:, 1:] += problem.weight_x
    diagonal[1:] += problem.weight_y
    band = np.zeros((band_width(problem) + 1, rows * columns))
    band[0] = diagonal.ravel()
    # With a single column both kinds of neighbour are the next point; one of them is absent.
    band[1] -= right.ravel()
    band[columns] -= down.ravel()
    if problem.means is not None:
        m = problem.means
        # Where nothing determines the heights, the row is that of the identity.
        _add_means(m.sets, m.weight, band)
    return band


def band_width(problem: HeightProblem) -> int:
    """Return the largest distance, in the order of the points, between two that are coupled."""
    width = problem.shape[1]
    if problem.means is not None:
        first = np.minimum.reduceat(problem.means.points, problem.means.start[:-1])
        last = np.maximum.reduceat(problem.means.points, problem.means.start[:-1])
        width = max(width, int((last - first).max()))
    return width


@compiled
def _add_means(sets: Sets, weight: FloatArray, band: FloatArray) -> None:
    start, points, share = sets
    for k in range(len(weight)):
        for a in range(start[k], start[k + 1]):
            for b in range(start[k], start[k + 1]):
                apart = points[b] - points[a]
                if apart >= 0:
                    band[apart, points[a]] += weight[k] * share[a] * share[b]


@compiled
def inverse_entries(factor: FloatArray, apart: IntArray) -> FloatArray:
    """Entries (j + k, j) of ``(L Lᵀ)⁻¹`` (K, N) by Takahashi's recursion, for K distances k.

    `factor[j, k]` is ``L[j + k, j]``, and `apart` has the distances, less than its width; entries
    beyond the last row are 0.

    Going backward, column j of the inverse within the band follows from the block of the
    inverse at j + 1 … j + b. That block is kept at the places (index mod b), so that a new
    column overwrites the one that leaves the band.
    """
    points, width = factor.shape[0], factor.shape[1] - 1
    # Four rows of the block at a time: the column is read and written a quarter as often. Elements
    # beyond the width remain 0.
    padded = -(-width // 4) * 4
    block = np.zeros((padded, padded))
    scaled, column = np.zeros((2, padded))
    found = np.zeros((apart.size, points))
    for j in range(points - 1, -1, -1):
        pivot = factor[j, 0]
        for k in range(1, width + 1):
            scaled[(j + k) % width] = factor[j, k] / pivot
        # The block is symmetric: sums of its rows equal those of its columns, and are far faster.
        column[:] = 0.0
        for k in range(0, padded, 4):
            a, b, c, d = scaled[k], scaled[k + 1], scaled[k + 2], scaled[k + 3]
            one, two, three, four = block[k], block[k + 1], block[k + 2], block[k + 3]
            for i in range(padded):
                column[i] -= a * one[i] + b * two[i] + c * three[i] + d * four[i]
        here = 1.0 / (pivot * pivot)
        place = j % width
        for k in range(width):
            here -= scaled[k] * column[k]
            block[place, k] = column[k]
            block[k, place] = column[k]
        block[place, place] = here
        for n in range(apart.size):
            k = apart[n]
            if j + k < points:
                found[n, j] = column[(j + k) % width] if k else here
    return found
