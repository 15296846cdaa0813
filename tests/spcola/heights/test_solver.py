"""The multigrid solver against direct solutions, identities, limits."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, label
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import spsolve

from spcola.compilation import Bands
from spcola.errors import InvalidValueError, SettingsError
from spcola.heights import HeightProblem, HeightSystem, SolverOptions, solve_heights
from spcola.heights.aggregation import AggregationCycle
from spcola.heights.components import find_components
from spcola.heights.conjugate import LinearSystem

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
