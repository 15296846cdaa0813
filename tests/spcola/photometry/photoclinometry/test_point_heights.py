"""Heights of single points as constraints, against dense least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import (
    HeightConstraint,
    PhotoclinometryOptions,
    solve_photoclinometry,
)
from spcola.photometry.photoclinometry.cell_surface import CellInformation
from spcola.photometry.photoclinometry.constraints import constrained_points, gathered
from spcola.photometry.photoclinometry.point_heights import PointEquations, PointHeights
from spcola.photometry.photoclinometry.surface import Surface
from spcola.photometry.photoclinometry.surface_equations import HeightEquations, Priors

GRID = MapletGrid.facing(np.array([80.0, 20.0, 10.0]), [0.9, 0.3, 0.2], 0.5, 3)
SLOPE_WEIGHT, TWIST_WEIGHT, POINT_WEIGHT = 4.0, 9.0, 0.3


def points_of(count, groups=2, *, sigma=0.05, covariance=None, seed=1):
    rng = np.random.default_rng(seed)
    reach = 0.999 * GRID.half_size * GRID.gsd
    places = np.column_stack([rng.uniform(-reach, reach, (count, 2)), rng.normal(0.0, 0.3, count)])
    shared = 0.01 * (np.eye(groups) + 0.5) if covariance is None else covariance
    return PointHeights(places, np.full(count, sigma), np.arange(count) % groups, shared)


def constraint_of(name, grid, points):
    return HeightConstraint.of_points(
        name, grid, points.places, points.sigma, points.group, points.covariance
    )


def surface():
    rng = np.random.default_rng(3)
    return Surface(GRID, rng.normal(0.0, 0.2, GRID.shape), np.ones((GRID.size - 1,) * 2))


def equations(points, now, heights=()):
    """Heights alone, with weak priors on slopes, twists and heights about those of the surface."""
    cells = (GRID.size - 1,) * 2
    normal = np.zeros((6, *cells))
    normal[[0, 3]] = SLOPE_WEIGHT
    nothing = CellInformation(
        normal, np.zeros((3, *cells)), np.zeros((0, *GRID.shape)), np.zeros((0, 0)), np.zeros(0)
    )
    weight = np.full(GRID.shape, POINT_WEIGHT)
    known = Priors(np.zeros((2, *cells)), 0.3, tuple(heights), PointEquations.of(points, GRID))
    return HeightEquations(
        nothing, known, now, weight, np.zeros(GRID.shape),
        np.full(cells, TWIST_WEIGHT),
    )  # fmt: skip


def rows_of(points):
    """Rows (N, R·C) that take heights of the grid to those at points, bilinearly."""
    rows = np.zeros((len(points), GRID.size**2))
    steps = points.places[:, :2] / GRID.gsd + GRID.half_size
    for row, (x, y) in zip(rows, steps, strict=True):
        i, j = int(y), int(x)
        for down, along in ((0, i + 1 - y), (1, y - i)):
            for over, across in ((0, j + 1 - x), (1, x - j)):
                row[(i + down) * GRID.size + j + over] = along * across
    return rows


def of_points(points, now):
    """Rows, residuals and covariance of points."""
    noise = np.diag(points.sigma**2) + points.covariance[np.ix_(points.group, points.group)]
    return rows_of(points), points.places[:, 2] - now.height_at(*points.places.T[:2]), noise


def dense(design, left, noise):
    """Heights and their covariance by generalised least squares."""
    normal = POINT_WEIGHT * np.eye(GRID.size**2)
    size = GRID.size
    for i in range(size - 1):
        for j in range(size - 1):
            corners = [i * size + j, i * size + j + 1, (i + 1) * size + j, (i + 1) * size + j + 1]
            slope = SLOPE_WEIGHT / (2 * GRID.gsd) ** 2
            signs = [(-1, 1, -1, 1, slope), (-1, -1, 1, 1, slope), (1, -1, -1, 1, TWIST_WEIGHT)]
            for *sign, weight in signs:
                normal[np.ix_(corners, corners)] += weight * np.outer(sign, sign)
    inverse = np.linalg.inv(noise)
    covariance = np.linalg.inv(normal + design.T @ inverse @ design)
    return covariance @ design.T @ inverse @ left, covariance


def test_heights_and_variances_are_those_of_least_squares_with_correlated_errors():
    points, now = points_of(40), surface()
    rise, nuisance = equations([points], now).solve(tolerance=1e-6)
    expected, covariance = dense(*of_points(points, now))
    assert nuisance.shape == (0,)
    np.testing.assert_allclose(rise.ravel(), expected, atol=1e-4)
    variance = equations([points], now).posterior().heights().ravel()
    np.testing.assert_allclose(variance, np.diag(covariance), rtol=1e-6)


def test_heights_of_the_grid_that_share_an_error_are_those_of_least_squares():
    """Two sets, of which one is known at some points only, and one has independent errors."""
    now, rng = surface(), np.random.default_rng(4)
    height, sigma = rng.normal(0.0, 0.3, (3, *GRID.shape)), rng.uniform(0.02, 0.2, (3, *GRID.shape))
    height[0, 2:5, 1:6] = np.nan
    shared = (0.2, 0.05, 0.0)
    constraints = tuple(
        replace(HeightConstraint.of_sigma("mapolas", *one), shared_sigma=common)
        for *one, common in zip(height, sigma, shared, strict=True)
    )
    heights, _ = gathered(constraints, GRID, GRID)
    assert [one.shared_sigma for one in heights] == [0.0, 0.2, 0.05]
    rows, left, noise = [], [], []
    for known, own, common in zip(height, sigma, shared, strict=True):
        there = np.isfinite(known).ravel()
        rows.append(np.eye(GRID.size**2)[there])
        left.append((known - now.height).ravel()[there])
        noise.append(np.diag(own.ravel()[there] ** 2) + common**2)
    expected, covariance = dense(np.concatenate(rows), np.concatenate(left), block_diag(*noise))
    found = equations([], now, heights)
    np.testing.assert_allclose(found.solve(tolerance=1e-8)[0].ravel(), expected, atol=1e-4)
    np.testing.assert_allclose(found.posterior().heights().ravel(), np.diag(covariance), rtol=1e-5)


def test_means_over_cells_give_the_heights_at_the_points():
    """The mean of a dome over a square of side a lies a²/24 of its Laplacian below its middle."""
    x, y = GRID.gsd * np.array(np.meshgrid(GRID.offsets, GRID.offsets))
    true = -0.3 * x**2 - 0.2 * y**2 + 0.1 * x * y
    square = GRID.gsd**2 * np.where(x > 0, 2.0, 1.0)
    means = true - (0.3 + 0.2) * square / 12.0
    given = HeightConstraint.of_sigma("mapolas", means, 1e-4)
    fits = []
    for constraint in (given, replace(given, blur=square / 12.0)):
        heights, _ = gathered((constraint,), GRID, GRID)
        now = Surface(GRID, np.zeros(GRID.shape), np.ones((GRID.size - 1,) * 2))
        for _ in range(12):
            rise, _ = equations([], now, heights).solve(tolerance=1e-9)
            now = Surface(GRID, now.height + rise, now.albedo)
        found = Maplet("AA0001", GRID, now.height)
        fits.append((np.abs(now.height - true).max(), constraint.fit(found).residual_m))
    (unaware, _), (error, residual) = fits
    assert unaware > 0.01
    assert error < 1e-4
    assert residual < 1e-5


@pytest.mark.parametrize("variance", [1.0 / 3.0, 0.75])
def test_rounds_converge_for_means_of_mapolas_coarser_than_the_grid(variance):
    """A mapola of 1.5 times the GSD has up to 0.75 squared steps; its noise is no parabola."""
    noise = np.random.default_rng(1).normal(0.0, 0.1, GRID.shape)
    heights = HeightConstraint.of_sigma("mapolas", noise, 1e-3)
    blur = np.full(GRID.shape, variance * GRID.gsd**2)
    gridded, _ = gathered((replace(heights, blur=blur),), GRID, GRID)
    now = Surface(GRID, np.zeros(GRID.shape), np.ones((GRID.size - 1,) * 2))
    for _ in range(12):
        rise, _ = equations([], now, gridded).solve(tolerance=1e-9)
        now = Surface(GRID, now.height + rise, now.albedo)
    assert np.abs(rise).max() < 1e-3
    assert np.abs(now.height).max() < 3.0 * np.abs(noise).max()


@pytest.mark.parametrize("blur", [-0.01, np.inf, np.nan])
def test_a_blur_that_is_none_is_refused(blur):
    heights = HeightConstraint.of_sigma("lidar", np.zeros(GRID.shape), 0.1)
    with pytest.raises(InvalidValueError, match="lidar: has a wrong blur"):
        replace(heights, blur=np.full(GRID.shape, blur))


@pytest.mark.parametrize("shared", [-0.01, np.inf, np.nan])
def test_a_shared_error_that_is_none_is_refused(shared):
    heights = HeightConstraint.of_sigma("lidar", np.zeros(GRID.shape), 0.1)
    with pytest.raises(InvalidValueError, match="lidar: has a wrong shared sigma"):
        replace(heights, shared_sigma=shared)


@pytest.mark.parametrize("least", [-0.01, np.inf, np.nan])
def test_a_least_sigma_that_is_none_is_refused(least):
    heights = HeightConstraint.of_sigma("shape", np.zeros(GRID.shape), 0.1)
    with pytest.raises(InvalidValueError, match="shape: has a wrong least sigma"):
        replace(heights, least_sigma=least)


@pytest.mark.parametrize("common", [0.0, 0.5, -1.0, np.inf, np.nan])
def test_an_error_that_less_than_one_point_shares_is_refused(common):
    heights = HeightConstraint.of_sigma("shape", np.zeros(GRID.shape), 0.1)
    with pytest.raises(InvalidValueError, match=r"shape: has errors that .* points share"):
        replace(heights, common=common)


def test_points_of_unknown_sigma_are_refused():
    with pytest.raises(InvalidValueError, match="returns: has points, whose sigmas must be known"):
        replace(constraint_of("returns", GRID, points_of(20)), least_sigma=0.1)


def test_heights_of_points_on_a_curved_surface_give_that_surface():
    """Between corners it lies up to 0.025 m above what is bilinear: points would lift it."""
    reach = 0.999 * GRID.half_size * GRID.gsd

    def hill(x, y):
        return -0.4 * (x**2 + y**2)

    places = np.random.default_rng(5).uniform(-reach, reach, (4000, 2))
    points = replace(
        points_of(4000, 1, sigma=0.01, covariance=1e-8 * np.eye(1)),
        places=np.column_stack([places, hill(*places.T)]),
    )
    offsets = GRID.offsets * GRID.gsd
    now = Surface(GRID, np.zeros(GRID.shape), np.ones((GRID.size - 1,) * 2))
    for _ in range(12):
        rise, _ = equations([points], now).solve(tolerance=1e-8)
        now = Surface(GRID, now.height + rise, now.albedo)
    error = now.height - hill(*np.meshgrid(offsets, offsets))
    # How the surface bends beyond its edge is not known.
    assert np.abs(error[1:-1, 1:-1]).max() < 4e-3
    assert np.abs(error).max() < 0.025


def test_an_error_that_a_group_shares_does_not_average_away():
    one = points_of(4000, 1, covariance=np.array([[0.04]]))
    many = points_of(4000, 400, covariance=0.04 * np.eye(400))
    alone, apart = (np.median(equations([p], surface()).posterior().heights()) for p in (one, many))
    # The other information on the mean height are the weak weights of all points.
    least = 1.0 / (1.0 / 0.04 + POINT_WEIGHT * GRID.size**2)
    assert least <= alone < 1.05 * least + 0.05**2
    assert apart < 0.1 * alone


def test_a_level_has_the_same_sums_in_wider_cells():
    points = points_of(60)
    coarse = GRID.with_gsd(2.0 * GRID.gsd)
    fine, wide = PointEquations.of([points], GRID), PointEquations.of([points], coarse)
    assert wide.diagonals.shape == (5, *coarse.shape)
    rights = [
        cells.about(Surface(level, np.zeros(level.shape), np.ones((level.size - 1,) * 2)))[0]
        for cells, level in ((fine, GRID), (wide, coarse))
    ]
    assert rights[0].sum() == pytest.approx(rights[1].sum())
    np.testing.assert_allclose(fine.shared, wide.shared)


def test_two_sets_of_points_have_groups_of_their_own():
    some, others = points_of(20, 2), points_of(30, 3, seed=7)
    both = PointEquations.of([some, others], GRID)
    assert both.coupled.shape[0] == len(both.shared) == 5
    assert not both.shared[:2, 2:].any()
    parts = [PointEquations.of([points], GRID).diagonals for points in (some, others)]
    np.testing.assert_allclose(both.diagonals, sum(parts))


def test_points_outside_the_grid_do_not_count():
    points = points_of(10)
    away = replace(points, places=points.places + np.array([10.0, 0.0, 0.0]))
    assert not PointEquations.of([away], GRID).diagonals.any()
    assert not constraint_of("away", GRID, away).weight.any()


def test_the_grid_knows_where_points_are_and_they_count_once():
    points = points_of(50)
    constraint = constraint_of("points", GRID, points)
    # The error that all points of a group share, here of one variance, is in each weight once.
    shared = points.covariance[0, 0]
    alone = constraint.weight / (1.0 - constraint.weight * shared)
    assert alone.sum() == pytest.approx(np.sum(points.sigma**-2.0))
    assert constraint.weight.max() < 1.0 / shared
    known = constraint.weight > 0.0
    assert (np.isfinite(constraint.height) == known).all()
    (heights,), cells = gathered((constraint,), GRID, GRID)
    assert not heights.weight.any()
    assert not heights.height.any()
    assert cells.weight.sum() == pytest.approx(alone.sum())


def test_a_subset_has_its_share_with_whole_weights():
    points = points_of(4000)
    some = constraint_of("points", GRID, points).subset(0.25, np.random.default_rng(5))
    assert len(some.points) == pytest.approx(1000, abs=100)
    np.testing.assert_allclose(some.points.sigma, points.sigma[0])
    grid = MapletGrid.facing(np.array([80.0, 20.0, 10.0]), [0.9, 0.3, 0.2], 0.5, 30)
    every = HeightConstraint.of_sigma("all", np.ones(grid.shape), 0.5)
    part = every.subset(0.25, np.random.default_rng(5))
    assert set(np.unique(part.weight)) == {0.0, 4.0}
    assert np.mean(part.weight > 0.0) == pytest.approx(0.25, abs=0.03)


def test_relief_within_cells_contradicts_no_surface_but_an_offset_does():
    """Returns of 1 cm on ground that varies by 0.2 m within a cell."""
    points, rng = (
        points_of(2000, 1, sigma=0.01, covariance=np.eye(1) * 1e-6),
        np.random.default_rng(8),
    )
    rough = np.column_stack([points.places[:, :2], rng.normal(0.0, 0.2, 2000)])
    flat = Maplet("FLAT", GRID, np.zeros(GRID.shape))

    def fit(rise):
        raised = replace(points, places=rough + np.array([0.0, 0.0, rise]))
        return constraint_of("returns", GRID, raised).fit(flat)

    assert fit(0.0).ratio == pytest.approx(1.0, abs=0.1)
    assert fit(0.0).residual_m == pytest.approx(0.2, rel=0.1)
    assert fit(1.0).ratio > 5.0
    # Too few share cells: their own sigma is all that is known.
    lone = replace(points, places=rough).subset(np.arange(2000) < 8)
    assert constraint_of("returns", GRID, lone).fit(flat).ratio > 5.0


def test_a_height_is_carried_as_far_as_asked():
    grid = MapletGrid.facing(np.array([80.0, 20.0, 10.0]), [0.9, 0.3, 0.2], 0.5, 20)
    height = np.full(grid.shape, np.nan)
    height[20, 20] = 1.0
    one = (HeightConstraint.of_sigma("one", height, 0.05),)
    near = constrained_points(one, grid, 11.1)
    assert near[20, 31]
    assert not near[20, 32]
    vague = (HeightConstraint.of_sigma("vague", height, 0.6),)
    assert not constrained_points(vague, grid, 11.1).any()
    assert not constrained_points((), grid, 11.1).any()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"sigma": np.zeros(4)}, "must be positive"),
        ({"sigma": np.ones(3)}, "sigmas of points"),
        ({"group": np.array([0, 0, 0, 2])}, "names a group that is not there"),
        ({"covariance": np.array([[1.0, 2.0], [2.0, 1.0]])}, "is not positive definite"),
        ({"places": np.full((4, 3), np.nan)}, "not finite"),
    ],
)
def test_wrong_points_are_refused(changed, words):
    with pytest.raises(InvalidValueError, match=words):
        replace(points_of(4), **changed)


def test_sparse_points_reach_ground_in_shadow_and_a_shared_offset_is_found(painted):
    """A quarter of the ground is dark in all images; one point in 9 cells, one scan 0.3 m high."""
    grid, truth = painted.grid, painted.heights()
    sights = [([0.3, 0, 1], [0.7, 0.1, 0.8]), ([-0.4, 0.2, 1], [-0.5, 0.4, 0.8]),
              ([0, 0.4, 1], [0.1, 0.7, 0.8]), ([0.1, -0.4, 1], [0.2, -0.6, 0.8])]  # fmt: skip
    images = [painted.photograph(f"I{k}", *sight, size=90) for k, sight in enumerate(sights)]
    dark = [
        replace(image, pixels=np.where(np.arange(90)[:, None] < 40, 0, image.pixels).astype("u2"))
        for image in images
    ]
    rng = np.random.default_rng(2)
    reach = grid.half_size * grid.gsd
    places = rng.uniform(-reach, reach, (grid.size**2 // 9, 2))
    group = rng.integers(0, 4, len(places))
    height = painted.height(*places.T) + np.array([0.3, 0.0, 0.0, 0.0])[group]
    sigma = np.full(len(places), 0.02)
    shared = 0.15**2 * np.eye(4)
    points = PointHeights(np.column_stack([places, height]), sigma, group, shared)
    options = PhotoclinometryOptions(function=lambert, least_error=1e-3)

    def error(*constraints):
        found = solve_photoclinometry(
            Maplet("FLAT", grid, np.zeros(grid.shape)), dark,
            {image.name: 1e-14 * np.eye(6) for image in dark},
            constraints=constraints, options=options,
        )  # fmt: skip
        return found, found.maplet.height - truth

    found, with_points = error(constraint_of("points", grid, points))
    unseen = np.zeros(grid.shape, dtype=bool)
    unseen[:-1, :-1] = found.directions == 0
    assert 0.1 < unseen.mean() < 0.6
    known = HeightConstraint.of_sigma("edge", np.where(unseen, np.nan, truth), 0.5, common=100)
    _, without = error(known)
    assert np.std(with_points[unseen]) < 0.3 * np.std(without[unseen])
    # Taken as exact, the scan that is 0.3 m high would make the ground rough.
    exact = replace(points, covariance=1e-8 * np.eye(4))
    _, rough = error(constraint_of("points", grid, exact))
    assert np.std(with_points[unseen]) < 0.8 * np.std(rough[unseen])


def test_noise_of_dense_points_stays_out_of_what_only_the_prior_limits(painted):
    """Points see little of h00 − h01 − h10 + h11, which the roughness of ground limits."""
    grid, truth = painted.grid, painted.heights()
    sights = [([0.3, 0, 1], [0.7, 0.1, 0.8]), ([-0.4, 0.2, 1], [-0.5, 0.4, 0.8])]
    images = [painted.photograph(f"I{k}", *sight, size=90) for k, sight in enumerate(sights)]
    rng = np.random.default_rng(4)
    reach, sigma = grid.half_size * grid.gsd, 0.15 * grid.gsd
    places = rng.uniform(-reach, reach, (4 * grid.size**2, 2))
    height = painted.height(*places.T) + rng.normal(0.0, sigma, len(places))
    every = np.zeros(len(places), dtype=int)
    points = PointHeights(
        np.column_stack([places, height]), np.full(len(places), sigma), every, np.eye(1) * 1e-6
    )
    found = solve_photoclinometry(
        Maplet("FLAT", grid, np.zeros(grid.shape)), images,
        {image.name: 1e-14 * np.eye(6) for image in images},
        constraints=[constraint_of("points", grid, points)],
        options=PhotoclinometryOptions(function=lambert),
    )  # fmt: skip
    error = (found.maplet.height - truth)[4:-4, 4:-4] / grid.gsd
    twist = np.diff(np.diff(error, axis=0), axis=1)
    # 0.022 with the prior of cells that only images see, 0.013 with that of rough ground.
    assert np.std(twist) < 0.015
