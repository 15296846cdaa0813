"""The published relaxation and the fast solver have one fixed point."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.heights import HeightProblem, SolverOptions, solve_heights
from spcola.heights.relaxation import relax
from spcola.heights.slopes import slopes_of, steps_from_slopes


def slopes_problem(size, gsd, rng):
    """Slopes of a rough surface with noise, a hole, and a few constraints of small weight."""
    slope_x, slope_y = rng.normal(0, 0.4, (2, size, size))
    step_x, step_y = steps_from_slopes(slope_x, slope_y, gsd)
    height = np.where(rng.random((size, size)) < 0.1, rng.normal(0, gsd, (size, size)), np.nan)
    mask = np.ones((size, size), dtype=bool)
    mask[3:6, 4:7] = False
    edges = np.ones((size, size - 1)), np.ones((size - 1, size))
    return HeightProblem(step_x, step_y, *edges, height, np.full((size, size), 0.1), mask)


@pytest.mark.parametrize(("size", "draw", "sweeps"), [(15, 4, 6000), (99, 5, 5500)])
def test_converged_relaxation_is_the_solution(size, draw, sweeps):
    gsd = 0.75
    problem = slopes_problem(size, gsd, np.random.default_rng(draw))
    relaxed = relax(problem, sweeps=sweeps, seed=1)
    solved = solve_heights(problem, options=SolverOptions(tolerance_m=1e-9)).height
    np.testing.assert_allclose(relaxed, solved, atol=1e-6 * gsd, rtol=0)


def test_same_seed_same_heights():
    problem = slopes_problem(12, 1.0, np.random.default_rng(4))
    once, again, other = (relax(problem, sweeps=3, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(once, again)
    assert not np.array_equal(once, other, equal_nan=True)


def test_solution_is_a_fixed_point_of_the_relaxation():
    problem = slopes_problem(20, 1.0, np.random.default_rng(7))
    solved = solve_heights(problem, options=SolverOptions(tolerance_m=1e-11)).height
    np.testing.assert_allclose(relax(problem, sweeps=2, seed=3, start=solved), solved, atol=1e-9)


def test_slopes_of_a_quadratic_surface():
    row, column = np.indices((9, 11)).astype(float)
    x, y = 0.5 * column, 0.5 * row
    height = 0.2 * x**2 - 0.1 * x * y + 0.3 * y
    slope_x, slope_y = slopes_of(height, 0.5)
    np.testing.assert_allclose(slope_x[:, 1:-1], (0.4 * x - 0.1 * y)[:, 1:-1], atol=1e-12)
    np.testing.assert_allclose(slope_y, -0.1 * x + 0.3, atol=1e-12)


def test_steps_of_exact_slopes_of_a_quadratic_are_its_differences():
    row, column = np.indices((9, 11)).astype(float)
    height = 0.2 * column**2 - 0.1 * column * row + 0.3 * row
    steps = steps_from_slopes(0.4 * column - 0.1 * row, -0.1 * column + 0.3, 1.0)
    np.testing.assert_allclose(steps[0], np.diff(height, axis=1), atol=1e-12)
    np.testing.assert_allclose(steps[1], np.diff(height, axis=0), atol=1e-12)


@pytest.mark.parametrize("missing", [(4, 5), (0, 0)])
def test_slopes_next_to_an_unknown_height_are_one_sided(missing):
    row, column = np.indices((9, 11)).astype(float)
    height = 2.0 * column + row
    height[missing] = np.nan
    slope_x, slope_y = slopes_of(height, 1.0)
    known = np.isfinite(height)
    np.testing.assert_allclose(slope_x[known], 2.0)
    np.testing.assert_allclose(slope_y[known], 1.0)
    assert np.isnan(slope_x[missing])
    assert np.isnan(slope_y[missing])
