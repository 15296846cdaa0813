"""Iterations of the multigrid solver do not grow with the grid, its weights or its masks."""

from __future__ import annotations

import numpy as np
import pytest
from height_problems import direct, normal_equations, random_problem
from scipy.ndimage import gaussian_filter

from spcola.heights import HeightProblem, SolverOptions, solve_heights
from spcola.heights.aggregation import AggregationCycle


def test_regions_of_very_different_weight_need_few_iterations():
    """A region a million times stiffer than its surroundings, as from two sources of slopes."""
    rng = np.random.default_rng(3)
    problem = random_problem(rng, (96, 96), sparse=0.02)
    inside = np.zeros((96, 96), dtype=bool)
    inside[20:61, 33:70] = True
    stiff = HeightProblem(
        problem.step_x,
        problem.step_y,
        np.where(inside[:, 1:] & inside[:, :-1], 1e6, 1.0),
        np.where(inside[1:] & inside[:-1], 1e6, 1.0),
        problem.height,
        problem.weight,
    )
    solution = solve_heights(stiff, options=SolverOptions(tolerance_m=1e-9))
    np.testing.assert_allclose(solution.height, direct(stiff), atol=1e-9, rtol=0)
    assert solution.iterations < 60


def weighted(size, kind, rng):
    """Edges of weights that jump over six orders of magnitude, and of masks of all sorts."""
    row, column = np.indices((size, size))
    mask, factor, sparse = np.ones((size, size), dtype=bool), np.ones((size, size)), 0.02
    if kind == "holes":
        mask = rng.random((size, size)) >= 0.02
    elif kind == "island":
        mask = np.hypot(row - size / 2, column - size / 2) < 0.4 * size
    elif kind == "blocks":
        factor = 10.0 ** rng.uniform(-3, 3, (-(-size // 16),) * 2)[row // 16, column // 16]
    elif kind == "checkerboard":
        factor = np.where((row // 16 + column // 16) % 2, 1e-6, 1.0)
    elif kind == "stripes":
        factor = 10.0 ** rng.uniform(-3, 3, size)[row]
    elif kind == "one height":
        sparse = 0.0
    height = np.where(rng.random((size, size)) < sparse, rng.normal(0, 5, (size, size)), np.nan)
    height[size // 2, size // 2] = 1.0
    weight_x = np.minimum(factor[:, 1:], factor[:, :-1])
    weight_y = np.minimum(factor[1:], factor[:-1])
    steps = rng.normal(size=(size, size - 1)), rng.normal(size=(size - 1, size))
    return HeightProblem(*steps, weight_x, weight_y, height, np.ones((size, size)), mask)


@pytest.mark.parametrize(
    ("kind", "most"),
    [
        ("plain", 13),
        ("holes", 17),
        ("island", 13),
        ("blocks", 22),
        ("one height", 13),
    ],
)
def test_iterations_do_not_grow_with_the_grid(kind, most):
    """Whole grids, holes of one point, one round piece, hard weights, a single height.

    Masks of narrow pieces have a test of their own below; so have thin ones and wild weights.
    """
    counts = []
    for size in (65, 129, 257, 513):
        problem = weighted(size, kind, np.random.default_rng(1))
        options = SolverOptions(tolerance_m=1e-6, floating="unknown")
        solution = solve_heights(problem, options=options)
        assert solution.converged, solution.reason
        counts.append(solution.iterations)
    assert max(counts) <= most, counts
    assert max(counts[1:]) <= 1.3 * min(counts[1:]) + 1, counts


def rough_problem(size, seed):
    """Pieces some ten points wide on 64 % of a grid, 2 % of the heights, as in the bench."""
    rng = np.random.default_rng(seed)
    pattern = gaussian_filter(rng.standard_normal((size, size)), 4.0)
    height = np.where(rng.random((size, size)) < 0.02, rng.normal(0, 5, (size, size)), np.nan)
    steps = rng.normal(size=(size, size - 1)), rng.normal(size=(size - 1, size))
    ones = [np.ones_like(each) for each in (*steps, height)]
    mask = pattern > np.quantile(pattern, 0.36)
    return HeightProblem(*steps, *ones[:2], height, ones[2], mask)


def test_iterations_do_not_grow_with_the_grid_on_rough_masks():
    """A larger rough mask has worse places: necks, corners that touch, pieces of one constraint.

    Counts grew when loose parts were shifted along with the cycle, not in turn, and when
    aggregates joined what the mask parts. Floating parts must not disturb the others: on coarse
    levels they end as points that nothing holds.
    """
    options = SolverOptions(tolerance_m=1e-6, floating="unknown")
    counts = []
    for size in (129, 257, 513, 1001):
        solutions = [solve_heights(rough_problem(size, seed), options=options) for seed in (0, 1)]
        assert all(solution.converged and len(solution.floating) for solution in solutions)
        counts.append(max(solution.iterations for solution in solutions))
    assert 8 <= min(counts) <= max(counts) <= 15, counts


@pytest.mark.parametrize("side", [7, 15])
def test_iterations_stay_few_where_pieces_touch_at_corners(side):
    """The squares of one colour of a chessboard, some joined by a bridge, some floating.

    With plain aggregates, which join the squares at their corners, there were 25 to 82 iterations.
    """
    counts = []
    for size in (8 * side, 32 * side):
        row, column = np.indices((size, size))
        problem = weighted(size, "plain", np.random.default_rng(4))
        mask = (row // side + column // side) % 2 == 0
        mask[:, side // 2] = True
        layers = (problem.step_x, problem.step_y, problem.weight_x, problem.weight_y)
        problem = HeightProblem(*layers, problem.height, problem.weight, mask)
        options = SolverOptions(tolerance_m=1e-6, floating="unknown")
        solution = solve_heights(problem, options=options)
        assert solution.converged, solution.reason
        counts.append(solution.iterations)
    assert max(counts) <= 24, counts


@pytest.mark.parametrize("kind", ["comb", "jumps", "stripes", "checkerboard"])
def test_wild_weights_and_thin_masks_need_a_bounded_number_of_cycles(kind):
    """One-cell teeth, and weights that jump by six orders between edges, rows or squares."""
    counts = []
    for size in (65, 129, 257):
        rng = np.random.default_rng(1)
        p = weighted(size, kind, rng)
        mask, weight_x, weight_y = np.array(p.mask), p.weight_x, p.weight_y
        if kind == "comb":
            mask[1:, 1::2] = False
        elif kind == "jumps":
            weight_x, weight_y = (10 ** rng.uniform(-3, 3, w.shape) for w in (weight_x, weight_y))
        problem = HeightProblem(p.step_x, p.step_y, weight_x, weight_y, p.height, p.weight, mask)
        options = SolverOptions(tolerance_m=1e-6, floating="unknown")
        solution = solve_heights(problem, options=options)
        assert solution.converged, solution.reason
        if size == 65:
            solved = np.isfinite(solution.height)
            np.testing.assert_array_equal(solved, mask)
            np.testing.assert_allclose(solution.height, direct(problem), atol=1e-6, rtol=0)
        counts.append(solution.iterations)
    # Even weights take 8 or 9.
    assert max(counts) <= 32, counts
    assert counts[-1] <= 1.2 * counts[0] + 5, counts


def test_aggregates_leave_out_points_that_their_constraint_holds():
    """Stiff pairs that a soft edge joins to a constrained point, for which it is the stiffest.

    Aggregates of all three would be as firm as that point: the cycle would leave 0.99 of
    what the pairs are off by.
    """
    size, rng = 66, np.random.default_rng(5)
    weight_x = np.broadcast_to(np.array([10, 0.01, 0.001])[np.arange(size - 1) % 3], (66, 65))
    weight_y = 10 ** rng.uniform(-5, -3, (size - 1, size))
    weight = np.where(np.arange(size) % 3 == 2, 1.0, 0.0) * np.ones((size, size))
    steps = np.zeros((size, size - 1)), np.zeros((size - 1, size))
    problem = HeightProblem(*steps, weight_x, weight_y, np.zeros((size, size)), weight)
    matrix, _ = normal_equations(problem)
    cycle, error = AggregationCycle(matrix), rng.normal(size=size**2)
    for _ in range(10):
        before, error = error, error - cycle.apply(matrix @ error)
    assert error @ (matrix @ error) < 0.3**2 * (before @ (matrix @ before))
