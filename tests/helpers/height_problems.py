"""Problems of heights, and their direct solution."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import spsolve

from spcola.heights import HeightProblem, SolverOptions
from spcola.heights.components import find_components

EXACT = SolverOptions(tolerance_m=1e-10)


def normal_equations(problem):
    """Matrix and right side of (A) over the points of the mask, written down edge by edge."""
    number = np.full(problem.shape, -1)
    number[problem.mask] = np.arange(problem.mask.sum())
    n = problem.mask.sum()
    rows, columns, values, right = [], [], [], np.zeros(n)
    for axis, step, weight in (
        (1, problem.step_x, problem.weight_x),
        (0, problem.step_y, problem.weight_y),
    ):
        a = number[:, :-1] if axis == 1 else number[:-1]
        b = number[:, 1:] if axis == 1 else number[1:]
        for i, j, s, w in zip(
            a[weight > 0], b[weight > 0], step[weight > 0], weight[weight > 0], strict=True
        ):
            rows += [i, j, i, j]
            columns += [i, j, j, i]
            values += [w, w, -w, -w]
            right[j] += w * s
            right[i] -= w * s
    used = problem.weight > 0
    rows += list(number[used])
    columns += list(number[used])
    values += list(problem.weight[used])
    right[number[used]] += problem.weight[used] * problem.height[used]
    return csc_array(coo_array((values, (rows, columns)), shape=(n, n))), right


def direct(problem):
    matrix, right = normal_equations(problem)
    height = np.full(problem.shape, np.nan)
    height[problem.mask] = spsolve(matrix, right)
    return height


def random_problem(rng, shape, *, decades=0.0, holes=0.0, cuts=0.0, sparse=1.0):
    rows, columns = shape

    def weights(size):
        return 10 ** rng.uniform(-decades / 2, decades / 2, size) * (rng.random(size) >= cuts)

    mask = rng.random(shape) >= holes
    height = np.where(rng.random(shape) < sparse, rng.normal(0, 5, shape), np.nan)
    problem = HeightProblem(
        rng.normal(size=(rows, columns - 1)),
        rng.normal(size=(rows - 1, columns)),
        weights((rows, columns - 1)),
        weights((rows - 1, columns)),
        height,
        weights(shape) * np.isfinite(height),
        mask,
    )
    return grounded(problem, rng)


def grounded(problem, rng):
    """Give every floating part one constraint, so that a direct solution exists."""
    parts = find_components(problem)
    height, weight = problem.height.copy(), problem.weight.copy()
    for part in parts.floating:
        r, c = np.argwhere(parts.labels == part)[0]
        height[r, c], weight[r, c] = rng.normal(), 0.1
    return HeightProblem(
        problem.step_x,
        problem.step_y,
        problem.weight_x,
        problem.weight_y,
        height,
        weight,
        problem.mask,
    )


def plane_problem(shape, slope_x, slope_y, *, edge=1.0, **layers):
    rows, columns = shape
    ones_x, ones_y = np.ones((rows, columns - 1)), np.ones((rows - 1, columns))
    return HeightProblem(slope_x * ones_x, slope_y * ones_y, edge * ones_x, edge * ones_y, **layers)
