"""The preconditioner, parts without constraints, precision and threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from height_problems import EXACT, direct, random_problem
from scipy.ndimage import label

from spcola.compilation import Bands
from spcola.errors import InvalidValueError
from spcola.heights import HeightProblem, HeightSystem, SolverOptions, solve_heights
from spcola.heights.components import find_components
from spcola.heights.conjugate import LinearSystem


@pytest.mark.parametrize("decades", [0.0, 6.0])
def test_preconditioner_is_symmetric_and_positive(decades):
    """What conjugate gradients need; for holes, islands and wild weights too."""
    rng = np.random.default_rng(12)
    problem = random_problem(rng, (21, 26), decades=decades, holes=0.3, cuts=0.3, sparse=0.05)
    bands, parts = Bands(problem.mask.size), find_components(problem)
    system = LinearSystem(problem, problem.weight, parts, bands)
    assert system.loose.any()
    precision = system.precision
    assert (precision == np.float64) == (decades > 0)
    epsilon = 100 * float(np.finfo(precision).eps)

    def inside():
        """Residuals as the iteration has them: their sum over a loose part is zero."""
        vector = np.zeros((23, 28), dtype=precision)
        residual = np.where(problem.mask, rng.normal(size=problem.shape), 0.0)
        for part in np.flatnonzero(system.loose):
            residual[parts.labels == part] -= residual[parts.labels == part].mean()
        vector[1:-1, 1:-1] = residual
        return vector

    for _ in range(10):
        u, v = inside(), inside()
        mu, mv = system.precondition(u, bands).copy(), system.precondition(v, bands).copy()
        assert float(np.sum(u * mv)) == pytest.approx(
            float(np.sum(v * mu)), rel=epsilon, abs=epsilon * float(np.sum(u * mu))
        )
        assert np.sum(u * mu) > 0


def test_wild_weights_and_a_floating_part_together():
    """The graph solver that takes over holds the floating part; it keeps the mean of the start."""
    rng = np.random.default_rng(13)
    joined = random_problem(rng, (48, 60), decades=6.0, sparse=0.1)
    weight_x, weight = joined.weight_x.copy(), joined.weight.copy()
    weight_x[:, 29] = 0.0
    weight[:, 30:] = 0.0
    parts = (joined.step_x, joined.step_y, weight_x, joined.weight_y, joined.height, weight)
    start = np.full((48, 60), 5.0)
    solution = solve_heights(HeightProblem(*parts), options=EXACT, start=start)
    assert solution.converged, solution.reason
    assert list(solution.floating) == [1]
    assert solution.height[:, 30:].mean() == pytest.approx(5.0, abs=1e-9)
    left = HeightProblem(
        joined.step_x[:, :29],
        joined.step_y[:, :30],
        weight_x[:, :29],
        joined.weight_y[:, :30],
        joined.height[:, :30],
        weight[:, :30],
    )
    np.testing.assert_allclose(solution.height[:, :30], direct(left), atol=1e-9)


def test_a_system_solves_for_other_steps_and_heights():
    rng = np.random.default_rng(14)
    first = random_problem(rng, (40, 33), holes=0.2, cuts=0.1, sparse=0.1)
    system = HeightSystem(first)
    np.testing.assert_array_equal(
        system.solve(first, options=EXACT).height, solve_heights(first, options=EXACT).height
    )
    for _ in range(3):
        other = first.with_data(
            rng.normal(size=first.step_x.shape),
            rng.normal(size=first.step_y.shape),
            rng.normal(size=first.shape),
        )
        solution = system.solve(other, options=EXACT)
        np.testing.assert_allclose(solution.height, direct(other), atol=1e-9, rtol=0)
        again = system.solve(other, options=SolverOptions(tolerance_m=1e-8), start=solution.height)
        assert again.iterations == 0
    with pytest.raises(InvalidValueError, match="other weights"):
        system.solve(random_problem(rng, (40, 33), sparse=0.1))
    with pytest.raises(InvalidValueError, match="not finite where its weight"):
        first.with_data(first.step_x, first.step_y, np.full(first.shape, np.nan))


def test_threads_of_one_large_problem_change_nothing():
    """More than one band of rows, with parts whose sums run over several of them."""
    problem = random_problem(np.random.default_rng(15), (1300, 900), holes=0.02, sparse=0.05)
    assert problem.mask.size > 1_000_000
    options = [SolverOptions(tolerance_m=1e-4, floating="unknown", threads=n) for n in (1, 2, 3)]
    one, two, three = (solve_heights(problem, options=each).height for each in options)
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, three)


@pytest.mark.parametrize("holes", [0.02, 0.35])
def test_parts_are_labelled_in_order_also_across_bands(holes):
    """On several threads; the labels are those of scipy, which numbers parts as they come."""
    shape = (1300, 900)
    rng = np.random.default_rng(17)
    mask = rng.random(shape) >= holes
    ones = np.ones((1300, 899)), np.ones((1299, 900))
    problem = HeightProblem(np.zeros_like(ones[0]), np.zeros_like(ones[1]), *ones, mask=mask)
    with Bands(mask.size, threads=3) as bands:
        assert len(bands.cut(*shape)) > 3
        parts = find_components(problem, bands)
    expected, count = label(mask)
    np.testing.assert_array_equal(parts.labels, expected - 1)
    np.testing.assert_array_equal(parts.size, np.bincount(expected.ravel())[1:])
    assert len(parts.floating) == count


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 1.0, 1e3])
def test_loose_and_firm_parts_next_to_each_other(weight):
    """Parts in narrow squares inside a firmly constrained frame: the coarse grids mix them."""
    rng = np.random.default_rng(18)
    size = 90
    mask = np.zeros((size, size), dtype=bool)
    mask.reshape(9, 10, 9, 10)[:, 1:, :, 1:] = True
    height = np.where(rng.random((size, size)) < 0.3, rng.normal(0, 5, (size, size)), np.nan)
    part = (np.arange(size) // 10)[:, None] * 9 + np.arange(size) // 10
    loose = part % 2 == 1
    single = np.zeros((size, size), dtype=bool)
    single[5::10, 5::10] = True
    height[loose & ~single] = np.nan
    height[single] = rng.normal(0, 5, single.sum())
    problem = HeightProblem(
        rng.normal(size=(size, size - 1)),
        rng.normal(size=(size - 1, size)),
        np.ones((size, size - 1)),
        np.ones((size - 1, size)),
        height,
        np.where(loose, weight, 1.0),
        mask,
    )
    solution = solve_heights(problem, options=SolverOptions(tolerance_m=1e-6))
    assert solution.converged, solution.reason
    assert solution.iterations <= 24, solution.iterations
    np.testing.assert_allclose(solution.height, direct(problem), atol=1e-6, rtol=0)


def test_single_precision_data_stay_so_and_solve_alike():
    problem = random_problem(np.random.default_rng(16), (60, 50), holes=0.2, sparse=0.1)
    layers = ("step_x", "step_y", "weight_x", "weight_y", "height", "weight")
    single = HeightProblem(
        *(getattr(problem, name).astype(np.float32) for name in layers), problem.mask
    )
    assert single.weight_x.dtype == np.float32
    np.testing.assert_allclose(
        solve_heights(single, options=EXACT).height,
        solve_heights(problem, options=EXACT).height,
        atol=1e-4,
    )


def test_threads_do_not_disturb_each_other():
    problems = [random_problem(np.random.default_rng(k), (40, 40), sparse=0.1) for k in range(8)]
    alone = [solve_heights(problem).height for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda problem: solve_heights(problem).height, problems))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)
