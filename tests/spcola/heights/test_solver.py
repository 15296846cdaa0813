"""The multigrid solver against direct solutions, identities, limits."""

from __future__ import annotations

import numpy as np
import pytest
from height_problems import EXACT, direct, plane_problem, random_problem

from spcola.errors import InvalidValueError, SettingsError
from spcola.heights import HeightProblem, SolverOptions, solve_heights


@pytest.mark.parametrize(
    ("shape", "how"),
    [
        ((17, 17), {}),
        ((40, 23), {"sparse": 0.02}),
        ((31, 64), {"holes": 0.1, "sparse": 0.05}),
        ((48, 48), {"holes": 0.45, "cuts": 0.1, "sparse": 0.1}),
        ((50, 41), {"cuts": 0.45, "sparse": 0.02}),
        ((48, 48), {"decades": 6.0, "sparse": 0.1}),
        ((45, 50), {"decades": 6.0, "holes": 0.3, "cuts": 0.2, "sparse": 0.05}),
        ((1, 60), {"sparse": 0.1}),
        ((60, 1), {"sparse": 0.1}),
        ((1, 1), {}),
    ],
)
def test_equals_the_direct_solution(shape, how):
    problem = random_problem(np.random.default_rng(7), shape, **how)
    solution = solve_heights(problem, options=EXACT)
    expected = direct(problem)
    assert solution.converged, solution.reason
    np.testing.assert_allclose(solution.height, expected, atol=1e-9, rtol=0)


def test_the_stated_bound_covers_the_error():
    """Also at loose tolerances, where the residual alone would mislead."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        problem = random_problem(rng, (60, 47), holes=0.3, cuts=0.1, sparse=0.01)
        expected = direct(problem)
        for tolerance in (1e-1, 1e-2, 1e-4, 1e-7):
            solution = solve_heights(problem, options=SolverOptions(tolerance_m=tolerance))
            error = np.nanmax(np.abs(solution.height - expected))
            assert solution.converged
            assert error <= solution.error_bound_m + 1e-12
            assert solution.error_bound_m <= tolerance


def test_plane_is_recovered_from_one_constraint():
    height = np.full((33, 20), np.nan)
    height[4, 7] = 2.0
    problem = plane_problem((33, 20), 0.3, -0.2, height=height, weight=np.full((33, 20), 1e-3))
    row, column = np.indices((33, 20))
    solution = solve_heights(problem, options=EXACT)
    expected = 2.0 + 0.3 * (column - 7) - 0.2 * (row - 4)
    np.testing.assert_allclose(solution.height, expected, atol=1e-9)


def test_raised_constraints_raise_the_surface():
    problem = random_problem(np.random.default_rng(5), (30, 37), holes=0.2, sparse=0.1)
    raised = HeightProblem(
        problem.step_x,
        problem.step_y,
        problem.weight_x,
        problem.weight_y,
        problem.height + 1.2e4,
        problem.weight,
        problem.mask,
    )
    low, high = (solve_heights(each, options=EXACT).height for each in (problem, raised))
    np.testing.assert_allclose(high - low, np.where(problem.mask, 1.2e4, np.nan), atol=1e-8)


def test_transposed_and_mirrored_problems_have_such_solutions():
    p = random_problem(np.random.default_rng(6), (30, 37), holes=0.2, cuts=0.1, sparse=0.1)
    height = solve_heights(p, options=EXACT).height
    turned = HeightProblem(
        p.step_y.T, p.step_x.T, p.weight_y.T, p.weight_x.T, p.height.T, p.weight.T, p.mask.T
    )
    np.testing.assert_allclose(solve_heights(turned, options=EXACT).height, height.T, atol=1e-9)
    mirrored = HeightProblem(
        -p.step_x[:, ::-1],
        p.step_y[:, ::-1],
        p.weight_x[:, ::-1],
        p.weight_y[:, ::-1],
        p.height[:, ::-1],
        p.weight[:, ::-1],
        p.mask[:, ::-1],
    )
    np.testing.assert_allclose(
        solve_heights(mirrored, options=EXACT).height, height[:, ::-1], atol=1e-9
    )


def test_a_good_start_spares_iterations_and_changes_nothing():
    problem = random_problem(np.random.default_rng(8), (50, 50), sparse=0.05)
    cold = solve_heights(problem, options=EXACT)
    warm = solve_heights(problem, options=EXACT, start=cold.height + 1e-9)
    assert warm.iterations < cold.iterations / 2
    np.testing.assert_allclose(warm.height, cold.height, atol=1e-9)


def two_islands():
    """A plane cut in two by missing edges, the left part constrained; one point outside."""
    height, mask = np.full((20, 21), np.nan), np.ones((20, 21), dtype=bool)
    height[3, 3] = 1.0
    mask[0, 0] = False
    whole = plane_problem((20, 21), 0.5, 0.25, height=height, weight=np.ones((20, 21)), mask=mask)
    weight_x = whole.weight_x.copy()
    weight_x[:, 10] = 0.0
    return HeightProblem(
        whole.step_x, whole.step_y, weight_x, whole.weight_y, height, whole.weight, mask
    )


def test_part_without_constraint_is_named_and_tied():
    problem = two_islands()
    row, column = np.indices(problem.shape)
    plane = 0.5 * column + 0.25 * row
    right = column > 10

    solution = solve_heights(problem, options=EXACT)
    assert list(solution.floating) == [1]
    assert np.array_equal(solution.components == 1, right)
    assert solution.components[0, 0] == -1
    assert np.isnan(solution.height[0, 0])
    np.testing.assert_allclose(
        solution.height[right], (plane - plane[right].mean())[right], atol=1e-9
    )
    np.testing.assert_allclose(
        solution.height[5, :11], (plane - plane[3, 3] + 1.0)[5, :11], atol=1e-9
    )

    start = np.where(column > 15, plane + 40.0, np.nan)
    tied = solve_heights(problem, options=EXACT, start=start)
    np.testing.assert_allclose(tied.height[right], plane[right] + 40.0, atol=1e-9)

    unknown = SolverOptions(floating="unknown")
    assert np.isnan(solve_heights(problem, options=unknown).height[right]).all()


def test_lone_point_is_unknown_not_zero():
    nothing = HeightProblem(np.zeros((1, 1)), np.zeros((0, 2)), np.zeros((1, 1)), np.zeros((0, 2)))
    solution = solve_heights(nothing)
    assert np.isnan(solution.height).all()
    assert len(solution.floating) == 2
    assert solve_heights(nothing, start=np.array([[3.0, np.nan]])).height[0, 0] == 3.0


@pytest.mark.parametrize(("loss", "left"), [("huber", 0.08), ("cauchy", 0.001)])
def test_robust_loss_down_weights_outliers(loss, left):
    rng = np.random.default_rng(2)
    row, column = np.indices((60, 60))
    plane = 0.1 * column + 0.05 * row
    height = np.where(rng.random((60, 60)) < 0.2, plane, np.nan)
    outlier = np.isfinite(height) & (rng.random((60, 60)) < 0.05)
    height[outlier] += 30.0
    problem = plane_problem(
        (60, 60), 0.1, 0.05, edge=400.0, height=height, weight=np.full((60, 60), 1 / 0.1**2)
    )
    square = solve_heights(problem)
    options = SolverOptions(loss=loss, loss_scale=2.0, tolerance_m=1e-5, max_reweights=100)
    robust = solve_heights(problem, options=options)
    assert robust.converged, robust.reason
    assert np.abs(square.height - plane).max() > 5.0
    assert np.abs(robust.height - plane).max() < left
    assert (robust.constraint_weight[outlier] < 0.05 * problem.weight[outlier]).all()


def test_running_out_of_iterations_is_said():
    problem = random_problem(np.random.default_rng(9), (64, 64), sparse=0.01)
    options = SolverOptions(tolerance_m=1e-10, max_iterations=3)
    solution = solve_heights(problem, options=options)
    assert not solution.converged
    assert "after 3 iterations" in solution.reason
    assert solution.error_bound_m > 1e-10


def test_problem_refuses_what_does_not_fit():
    ones = np.ones
    with pytest.raises(InvalidValueError, match="weight_x"):
        HeightProblem(ones((4, 4)), ones((3, 5)), ones((4, 5)), ones((3, 5)))
    with pytest.raises(InvalidValueError, match="step_y"):
        HeightProblem(ones((4, 4)), ones((4, 5)), ones((4, 4)), ones((3, 5)))
    with pytest.raises(InvalidValueError, match="negative or not finite"):
        HeightProblem(ones((4, 4)), ones((3, 5)), -ones((4, 4)), ones((3, 5)))
    with pytest.raises(InvalidValueError, match=r"step_x.*set the weight to 0"):
        HeightProblem(np.full((4, 4), np.nan), ones((3, 5)), ones((4, 4)), ones((3, 5)))
    with pytest.raises(InvalidValueError, match="infinite height"):
        HeightProblem(
            ones((4, 4)), ones((3, 5)), ones((4, 4)), ones((3, 5)), np.full((4, 5), np.inf)
        )
    HeightProblem(np.full((4, 4), np.nan), ones((3, 5)), np.zeros((4, 4)), ones((3, 5)))
    with pytest.raises(SettingsError, match="loss"):
        SolverOptions(loss="l1")
    with pytest.raises(SettingsError, match="tolerance_m"):
        SolverOptions(tolerance_m=0.0)


def test_masked_points_and_heights_do_not_take_part():
    problem = random_problem(np.random.default_rng(11), (30, 30), holes=0.3, sparse=0.2)
    shaken = HeightProblem(
        problem.step_x,
        problem.step_y,
        np.where(problem.weight_x > 0, problem.weight_x, 0.0),
        problem.weight_y,
        np.where(problem.mask, problem.height, 1e9),
        np.where(problem.mask, problem.weight, 1e9),
        problem.mask,
    )
    np.testing.assert_array_equal(solve_heights(problem).height, solve_heights(shaken).height)
