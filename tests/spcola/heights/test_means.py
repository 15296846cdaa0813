"""Constraints on means against dense algebra; detail inside a cell is left to the steps."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import InvalidValueError, SettingsError
from spcola.heights import (
    HeightProblem,
    MeanConstraints,
    SolverOptions,
    posterior_sigma,
    solve_heights,
)
from spcola.heights.components import find_components
from spcola.heights.graph import normal_matrix
from spcola.heights.posterior import PosteriorOptions
from spcola.heights.relaxation import relax

EXACT = SolverOptions(tolerance_m=1e-10)


def blocks(shape, k):
    """Label image of k × k blocks."""
    row, column = np.indices(shape)
    return (row // k) * -(-shape[1] // k) + column // k


def problem_of(rng, shape, k, *, weight=1.0, sparse=0.0, holes=0.0):
    rows, columns = shape
    labels = blocks(shape, k)
    sets = labels.max() + 1
    height = np.where(rng.random(shape) < sparse, rng.normal(size=shape), np.nan)
    means = MeanConstraints.of_labels(
        np.where(rng.random(sets) < 0.7, np.arange(sets), -1)[labels],
        rng.normal(size=sets),
        np.full(sets, weight),
    )
    return HeightProblem(
        rng.normal(size=(rows, columns - 1)),
        rng.normal(size=(rows - 1, columns)),
        np.ones((rows, columns - 1)),
        np.ones((rows - 1, columns)),
        height,
        np.full(shape, 0.5),
        rng.random(shape) >= holes,
        means,
    )


def dense(problem):
    """Normal matrix and right side over all points, from rows of a design matrix."""
    size = problem.mask.size
    number = np.arange(size).reshape(problem.shape)
    design, data, weights = [], [], []

    def observe(points, factors, value, weight):
        row = np.zeros(size)
        np.add.at(row, points, factors)
        design.append(row)
        data.append(value)
        weights.append(weight)

    for a, b, step, weight in (
        (number[:, :-1], number[:, 1:], problem.step_x, problem.weight_x),
        (number[:-1], number[1:], problem.step_y, problem.weight_y),
    ):
        for i, j, s, w in zip(a.ravel(), b.ravel(), step.ravel(), weight.ravel(), strict=True):
            observe([i, j], [-1, 1], s, w)
    for i in np.flatnonzero(problem.weight):
        observe([i], [1], problem.height.flat[i], problem.weight.flat[i])
    m = problem.means
    for k in range(len(m.height)):
        part = slice(m.start[k], m.start[k + 1])
        observe(m.points[part], m.share[part], m.height[k], m.weight[k])
    design, weights = np.array(design), np.array(weights)
    return design.T * weights @ design, design.T @ (weights * np.array(data))


@pytest.mark.parametrize(
    ("shape", "k", "how"),
    [
        ((24, 31), 4, {}),
        ((24, 31), 1, {}),
        ((30, 17), 5, {"sparse": 0.05, "weight": 100.0}),
        ((28, 28), 3, {"holes": 0.3, "sparse": 0.3}),
        ((26, 26), 26, {}),
    ],
)
def test_equals_the_dense_solution(shape, k, how):
    problem = problem_of(np.random.default_rng(k), shape, k, **how)
    matrix, right = dense(problem)
    parts = find_components(problem)
    known = (problem.mask & ~parts.is_floating).ravel()
    expected = np.full(known.shape, np.nan)
    expected[known] = np.linalg.solve(matrix[np.ix_(known, known)], right[known])
    solution = solve_heights(problem, options=SolverOptions(tolerance_m=1e-10, floating="unknown"))
    assert solution.converged, solution.reason
    np.testing.assert_allclose(solution.height.ravel(), expected, atol=1e-8, rtol=0)
    inside = problem.mask.ravel()
    sparse = normal_matrix(problem, problem.weight).toarray()
    np.testing.assert_allclose(sparse, matrix[np.ix_(inside, inside)], atol=1e-12)
    sigma = np.full(known.shape, np.nan)
    sigma[known] = np.sqrt(np.diag(np.linalg.inv(matrix[np.ix_(known, known)])))
    np.testing.assert_allclose(posterior_sigma(problem).ravel(), sigma, rtol=1e-7)


@pytest.mark.parametrize("weight", [1e3, 1e4])
def test_a_mean_leaves_the_detail_to_the_steps(weight):
    """The means of a planted surface, and true steps: all of it comes back; raised: a constant.

    Means so much stiffer than the steps are left to the multigrid along strong edges.
    """
    rng = np.random.default_rng(3)
    shape, k = (40, 40), 8
    surface = rng.normal(size=shape)
    labels = blocks(shape, k)
    mean = np.bincount(labels.ravel(), surface.ravel()) / k**2
    ones = np.ones
    for lift in (0.0, 5.0):
        problem = HeightProblem(
            np.diff(surface, axis=1),
            np.diff(surface, axis=0),
            ones((40, 39)),
            ones((39, 40)),
            means=MeanConstraints.of_labels(labels, mean + lift, np.full(len(mean), weight)),
        )
        solution = solve_heights(problem, options=EXACT)
        np.testing.assert_allclose(solution.height, surface + lift, atol=1e-8)
        assert len(solution.floating) == 0


def test_stiff_means_on_smooth_steps_are_met_and_steps_share_the_misfit():
    """One block raised against slopes of zero: its mean is met, its edges are not steps."""
    labels = np.full((30, 30), -1)
    labels[10:14, 10:14], labels[20:24, 20:24] = 0, 1
    problem = HeightProblem(
        np.zeros((30, 29)),
        np.zeros((29, 30)),
        np.ones((30, 29)),
        np.ones((29, 30)),
        means=MeanConstraints.of_labels(labels, [1.0, 0.0], [1e4, 1e4]),
    )
    solution = solve_heights(problem, options=EXACT)
    height = solution.height
    assert height[10:14, 10:14].mean() == pytest.approx(1.0, abs=1e-3)
    assert height[20:24, 20:24].mean() == pytest.approx(0.0, abs=1e-3)
    assert np.abs(np.diff(height, axis=0)).max() < 0.25


def test_a_mean_joins_pieces_and_holds_them():
    weight_x = np.ones((6, 9))
    weight_x[:, 4] = 0.0
    labels = np.full((6, 10), -1)
    labels[2:4, 4:6] = 0
    height = np.full((6, 10), np.nan)
    height[0, 0] = 2.0
    problem = HeightProblem(
        np.zeros((6, 9)),
        np.zeros((5, 10)),
        weight_x,
        np.ones((5, 10)),
        height,
        np.ones((6, 10)),
        means=MeanConstraints.of_labels(labels, [3.0], [1.0]),
    )
    solution = solve_heights(problem, options=EXACT)
    assert len(solution.floating) == 0
    np.testing.assert_allclose(solution.height[:, :5], 2.0, atol=1e-8)
    np.testing.assert_allclose(solution.height[:, 5:], 4.0, atol=1e-8)


@pytest.mark.parametrize("method", ["patches", "probing"])
def test_sigma_of_large_grids_includes_means(method):
    problem = problem_of(np.random.default_rng(8), (60, 60), 4, sparse=0.05)
    options = PosteriorOptions(core=20, margin=16, samples=120)
    ratio = posterior_sigma(problem, method=method, options=options) / posterior_sigma(problem)
    assert np.abs(np.median(ratio) - 1) < 0.02
    assert np.quantile(np.abs(ratio - 1), 0.95) < 0.1


def test_what_does_not_fit_is_refused():
    one = np.ones(1)
    with pytest.raises(InvalidValueError, match="divide the points"):
        MeanConstraints([0, 2], [0], one, one, one)
    with pytest.raises(InvalidValueError, match="share"):
        MeanConstraints([0, 1], [0], -one, one, one)
    with pytest.raises(InvalidValueError, match="negative or not finite"):
        MeanConstraints([0, 1], [0], one, one, -one)
    with pytest.raises(InvalidValueError, match="beyond"):
        MeanConstraints.of_labels(np.array([[0, 3]]), one, one)
    problem = problem_of(np.random.default_rng(1), (9, 9), 3)
    with pytest.raises(InvalidValueError, match="relaxed"):
        relax(problem, sweeps=1, seed=0)
    wide = HeightProblem(
        np.zeros((300, 299)),
        np.zeros((299, 300)),
        np.ones((300, 299)),
        np.ones((299, 300)),
        means=MeanConstraints.of_labels(blocks((300, 300), 30), np.zeros(100), np.ones(100)),
    )
    with pytest.raises(SettingsError, match="such wide areas"):
        posterior_sigma(wide, method="exact")
    outside = MeanConstraints([0, 1], [81], one, one, one)
    with pytest.raises(InvalidValueError, match="outside the grid"):
        HeightProblem(
            problem.step_x, problem.step_y, problem.weight_x, problem.weight_y, means=outside
        )


def test_means_over_wild_weights_are_met_in_few_iterations():
    """Means of 8 × 8 points over edges whose weights are drawn from six orders of magnitude."""
    size, rng = 96, np.random.default_rng(1)
    surface = rng.normal(size=(size, size)).cumsum(axis=0)
    label = np.kron(np.arange(144).reshape(12, 12), np.ones((8, 8), dtype=int))
    mean = np.bincount(label.ravel(), surface.ravel()) / 64.0
    problem = HeightProblem(
        np.diff(surface, axis=1),
        np.diff(surface, axis=0),
        10 ** rng.uniform(-3, 3, (size, size - 1)),
        10 ** rng.uniform(-3, 3, (size - 1, size)),
        np.where(rng.random((size, size)) < 0.02, surface, np.nan),
        np.ones((size, size)),
        means=MeanConstraints.of_labels(label, mean, np.full(144, 100.0)),
    )
    solution = solve_heights(problem, options=SolverOptions(tolerance_m=1e-5))
    assert solution.converged, solution.reason
    assert solution.iterations < 100
    np.testing.assert_allclose(solution.height, surface, atol=1e-5)


def test_pieces_that_only_means_connect_are_solved():
    """Their relative heights move without energy: the matrix is singular."""
    size, rng = 99, np.random.default_rng(3)
    surface = rng.normal(size=(size, size)).cumsum(axis=0)
    label, mask = blocks((size, size), 6), rng.random((size, size)) >= 0.2
    mean = np.bincount(label[mask], surface[mask]) / np.bincount(label[mask])
    problem = HeightProblem(
        np.diff(surface, axis=1),
        np.diff(surface, axis=0),
        np.full((size, size - 1), 1e4),
        np.full((size - 1, size), 1e4),
        mask=mask,
        means=MeanConstraints.of_labels(label, mean, np.full(len(mean), 1e3)),
    )
    solution = solve_heights(problem, options=SolverOptions(tolerance_m=1e-5))
    assert solution.converged, solution.reason
    steps = np.diff(solution.height, axis=1) - problem.step_x
    np.testing.assert_allclose(steps[problem.weight_x > 0], 0.0, atol=1e-4)
    found = np.bincount(label[mask], solution.height[mask]) / np.bincount(label[mask])
    np.testing.assert_allclose(found, mean, atol=1e-4)
