"""The posterior sigma against dense inverses, Monte Carlo, bounds."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.heights import HeightProblem, SolverOptions, posterior_sigma, solve_heights
from spcola.heights.components import find_components
from spcola.heights.posterior import PosteriorOptions


def random_problem(rng, shape, *, holes=0.0, cuts=0.0, sparse=0.1, weight=1.0, decades=0.0):
    rows, columns = shape

    def weights(size):
        return 10 ** rng.uniform(-decades / 2, decades / 2, size) * (rng.random(size) >= cuts)

    return HeightProblem(
        np.zeros((rows, columns - 1)),
        np.zeros((rows - 1, columns)),
        weights((rows, columns - 1)),
        weights((rows - 1, columns)),
        np.zeros(shape),
        np.where(rng.random(shape) < sparse, weight, 0.0),
        rng.random(shape) >= holes,
    )


def dense_sigma(problem):
    """√diag of the dense inverse of the normal matrix; NaN on parts without a constraint."""
    size = problem.mask.size
    number = np.arange(size).reshape(problem.shape)
    matrix = np.diag(problem.weight.ravel())
    edges = (
        (number[:, :-1], number[:, 1:], problem.weight_x),
        (number[:-1], number[1:], problem.weight_y),
    )
    for a, b, w in edges:
        for i, j, v in zip(a.ravel(), b.ravel(), w.ravel(), strict=True):
            matrix[i, i] += v
            matrix[j, j] += v
            matrix[i, j] -= v
            matrix[j, i] -= v
    known = (problem.mask & ~find_components(problem).is_floating).ravel()
    sigma = np.full(size, np.nan)
    sigma[known] = np.sqrt(np.diag(np.linalg.inv(matrix[np.ix_(known, known)])))
    return sigma.reshape(problem.shape)


@pytest.mark.parametrize(
    ("shape", "how"),
    [
        ((20, 20), {}),
        ((14, 31), {"holes": 0.2}),
        ((31, 14), {"holes": 0.3, "cuts": 0.3}),
        ((18, 18), {"decades": 6.0}),
        ((1, 30), {}),
        ((30, 1), {}),
        ((2, 2), {"sparse": 0.6}),
    ],
)
def test_exact_is_the_diagonal_of_the_dense_inverse(shape, how):
    problem = random_problem(np.random.default_rng(1), shape, **how)
    expected = dense_sigma(problem)
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(posterior_sigma(problem), expected, rtol=1e-8)


def test_exact_is_the_scatter_of_solutions():
    rng = np.random.default_rng(2)
    p = random_problem(rng, (12, 12), holes=0.1, sparse=0.1, weight=4.0)
    solutions = []
    for _ in range(1000):
        noisy = HeightProblem(
            rng.normal(size=p.step_x.shape),
            rng.normal(size=p.step_y.shape),
            p.weight_x,
            p.weight_y,
            0.5 * rng.normal(size=p.shape),
            p.weight,
            p.mask,
        )
        options = SolverOptions(tolerance_m=1e-4, floating="unknown")
        solutions.append(solve_heights(noisy, options=options).height)
    scatter = np.std(solutions, axis=0)
    np.testing.assert_allclose(
        scatter / posterior_sigma(p), np.where(np.isfinite(scatter), 1, np.nan), atol=0.1
    )


def test_sigma_scales_with_noise_level_and_weights():
    p = random_problem(np.random.default_rng(3), (15, 15))
    sigma = posterior_sigma(p)
    np.testing.assert_allclose(posterior_sigma(p, noise_level=2.5), 2.5 * sigma, rtol=1e-12)
    heavier = HeightProblem(
        p.step_x, p.step_y, 4 * p.weight_x, 4 * p.weight_y, p.height, 4 * p.weight
    )
    np.testing.assert_allclose(posterior_sigma(heavier), sigma / 2, rtol=1e-10)
    # A constraint alone: sigma is that of the constraint.
    alone = HeightProblem(
        np.zeros((1, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((0, 1)), [[0.0]], [[16.0]]
    )
    assert posterior_sigma(alone)[0, 0] == pytest.approx(0.25)


def test_downweighted_constraints_make_sigma_grow():
    p = random_problem(np.random.default_rng(3), (15, 15))
    robust = posterior_sigma(p, weight=0.25 * p.weight)
    assert (robust > posterior_sigma(p)).all()


def test_parts_that_float_have_no_sigma():
    weight_x = np.ones((8, 9))
    weight_x[:, 4] = 0.0
    weight = np.zeros((8, 10))
    weight[2, 2] = 1.0
    p = HeightProblem(
        np.zeros((8, 9)), np.zeros((7, 10)), weight_x, np.ones((7, 10)), weight, weight
    )
    for method in ("exact", "patches", "probing"):
        sigma = posterior_sigma(p, method=method, options=PosteriorOptions(samples=5))
        assert np.isfinite(sigma[:, :5]).all()
        assert np.isnan(sigma[:, 5:]).all()


WINDOWS = PosteriorOptions(core=24, margin=16, samples=120)


def test_patches_agree_with_the_exact_sigma():
    p = random_problem(np.random.default_rng(4), (99, 99), holes=0.1, sparse=0.1, weight=1.0)
    ratio = posterior_sigma(p, method="patches", options=WINDOWS) / posterior_sigma(p)
    known = np.isfinite(ratio)
    assert np.array_equal(known, np.isfinite(posterior_sigma(p)))
    assert (ratio[known] >= 1 - 1e-9).all()
    assert (ratio[known] < 1.01).all()


def test_a_grid_whose_band_is_too_large_is_parted(monkeypatch):
    p = random_problem(np.random.default_rng(4), (60, 50), sparse=0.1)
    monkeypatch.setattr("spcola.heights.posterior._EXACT_LIMIT", 60 * 50 * 50)
    np.testing.assert_array_equal(posterior_sigma(p), posterior_sigma(p, method="exact"))
    monkeypatch.setattr("spcola.heights.posterior._EXACT_LIMIT", 60 * 50 * 50 - 1)
    np.testing.assert_array_equal(posterior_sigma(p), posterior_sigma(p, method="patches"))


@pytest.mark.parametrize("weight", [1e-2, 1e-4])
def test_probing_agrees_with_the_exact_sigma_for_any_weight(weight):
    """Also for weak constraints, felt over hundreds of steps."""
    p = random_problem(np.random.default_rng(5), (70, 70), holes=0.1, sparse=0.02, weight=weight)
    ratio = posterior_sigma(p, method="probing", options=WINDOWS) / posterior_sigma(p)
    known = np.isfinite(ratio)
    assert np.abs(ratio[known] - 1).max() < 0.1


@pytest.mark.parametrize(("method", "weak"), [("patches", 1e-2), ("probing", 1e-2), ("probing", 0)])
def test_lidar_here_and_only_weak_heights_there(method, weak):
    """As in the fusion: returns dense on one side, on the other the maplet's own, or none."""
    rng = np.random.default_rng(9)
    column = np.indices((70, 70))[1]
    lidar = (column < 35) & (rng.random((70, 70)) < 0.6)
    weight = np.where(lidar, 4.0, weak)
    edges = 10 ** rng.uniform(-0.5, 0.5, (70, 69)), 10 ** rng.uniform(-0.5, 0.5, (69, 70))
    p = HeightProblem(np.zeros((70, 69)), np.zeros((69, 70)), *edges, np.zeros((70, 70)), weight)
    ratio = posterior_sigma(p, method=method, options=WINDOWS) / posterior_sigma(p)
    assert abs(np.median(ratio) - 1) < 0.03
    assert np.quantile(np.abs(ratio - 1), 0.95) < 0.1


def test_what_does_not_fit_is_refused():
    p = random_problem(np.random.default_rng(6), (9, 9))
    with pytest.raises(SettingsError, match="noise_level"):
        posterior_sigma(p, noise_level=0.0)
    with pytest.raises(SettingsError, match="method"):
        posterior_sigma(p, method="guess")
    large = random_problem(np.random.default_rng(6), (500, 500))
    with pytest.raises(SettingsError, match="too large"):
        posterior_sigma(large, method="exact")
    with pytest.raises(SettingsError, match="samples"):
        PosteriorOptions(samples=1)
