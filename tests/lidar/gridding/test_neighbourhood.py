"""Slopes by planes, expectations by medians, and who supports whom."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding import grid_returns
from lidar.gridding.cells import fit_planes
from lidar.gridding.cells.windows import PlaneWindows
from lidar.gridding.rejection.neighbourhood import count_support, expect
from lidar.scans import Returns
from spcola.grids import MapletGrid

SHAPE = (9, 11)
ROW, COLUMN = np.mgrid[:9, :11].astype(float)


def scattered(seed, empty=0.3):
    """Places and heights of a plane with slopes 0.4 and −0.7 per step, some cells empty."""
    rng = np.random.default_rng(seed)
    place_x, place_y = rng.uniform(-0.5, 0.5, (2, *SHAPE))
    height = 2.0 + 0.4 * (COLUMN + place_x) - 0.7 * (ROW + place_y)
    height[rng.random(SHAPE) < empty] = np.nan
    return place_x, place_y, height


def test_planes_have_the_slope_of_the_ground_wherever_the_places_are():
    place_x, place_y, height = scattered(1)
    weight = np.random.default_rng(2).uniform(0.5, 1.0, SHAPE)
    fit = fit_planes(place_x, place_y, height, weight, baseline=0.3, max_radius=3)
    known = np.isfinite(height)
    assert np.abs(fit.slope_x[known] - 0.4).max() < 1e-13
    assert np.abs(fit.slope_y[known] + 0.7).max() < 1e-13
    assert (fit.unresolved == 0).all()
    assert (fit.slope_x[~known] == 0).all()


@pytest.mark.parametrize("empty", [0.0, 0.3, 0.9])
def test_kept_factors_give_the_slopes_of_the_planes(empty):
    place_x, place_y, height = scattered(5, empty)
    rng = np.random.default_rng(6)
    known = np.isfinite(height)
    place_x[~known] = place_y[~known] = np.nan
    weight = np.where(known, rng.uniform(0.5, 1.0, SHAPE), 0.0)
    windows = PlaneWindows(place_x, place_y, weight, baseline=0.3, max_radius=3)
    for _ in range(3):
        rough = height + rng.normal(size=SHAPE)
        fit = fit_planes(place_x, place_y, rough, weight, baseline=0.3, max_radius=3)
        slope_x, slope_y = windows.slopes(rough)
        assert slope_x == pytest.approx(fit.slope_x, abs=1e-12)
        assert slope_y == pytest.approx(fit.slope_y, abs=1e-12)
        again = windows.fit(rough)
        for layer, other in zip(vars(fit).values(), vars(again).values(), strict=True):
            np.testing.assert_array_equal(layer, other)


def test_leverage_is_the_variance_that_sampled_noise_gives():
    place_x, place_y, height = scattered(3)
    rng = np.random.default_rng(4)
    weight = np.ones(SHAPE)
    carried = []
    for _ in range(4000):
        noisy = height + rng.normal(size=SHAPE)
        fit = fit_planes(place_x, place_y, noisy, weight, baseline=0.3, max_radius=3)
        carried.append(np.stack([noisy - height, -fit.slope_x * place_x - fit.slope_y * place_y]))
    own, correction = np.array(carried).transpose(1, 0, 2, 3)
    known = np.isfinite(height)
    variance, covariance = correction.var(axis=0), (own * correction).mean(axis=0)
    # A variance from 4000 samples is known to 2.2 %, the largest of 70 to three times that.
    assert variance[known] == pytest.approx(fit.leverage[known], rel=0.09)
    assert covariance[known] == pytest.approx(fit.own[known], abs=0.06)


def test_a_single_track_has_a_slope_along_but_none_across():
    place = np.zeros(SHAPE)
    height = np.full(SHAPE, np.nan)
    height[4] = 0.4 * COLUMN[4]
    fit = fit_planes(place, place + 0.25, height, np.ones(SHAPE), baseline=0.3, max_radius=2)
    assert fit.slope_x[4] == pytest.approx(np.full(11, 0.4), abs=1e-14)
    assert np.abs(fit.slope_y[4]).max() < 1e-14
    assert fit.unresolved[4] == pytest.approx(np.full(11, 0.25**2), abs=1e-14)


def test_a_track_across_a_mapola_has_larger_sigma_where_it_misses_the_grid_points():
    grid = MapletGrid.facing([100.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0, 10)
    x = np.linspace(-10.4, 10.4, 200)
    plane = x[:, None] * grid.ux + 0.4 * grid.uy + (0.5 * x)[:, None] * grid.uz
    returns = Returns(grid.center + plane, np.full(200, 0.01), np.zeros(200, dtype=int), ("track",))
    result = grid_returns("A", grid, returns)
    known = result.mapola.valid
    assert known.sum() == 21
    assert np.array_equal(np.unique(np.nonzero(known)[0]), [10])
    # Slopes on this ground are typically 0.5/√2 along one axis; 0.4 m remain uncorrected.
    sigma = result.mapola.sigma[known]
    assert sigma == pytest.approx(np.full(21, 0.4 * 0.5 / np.sqrt(2)), rel=0.01)


def reference_expectation(place_x, place_y, height, row, column):
    rows = slice(max(0, row - 2), row + 3)
    columns = slice(max(0, column - 2), column + 3)
    others = height.copy()
    others[row, column] = np.nan
    window = others[rows, columns]
    slope_x, slope_y = np.nanmedian(np.diff(window, axis=1)), np.nanmedian(np.diff(window, axis=0))
    x, y = COLUMN + place_x, ROW + place_y
    carried = height + slope_x * (x[row, column] - x) + slope_y * (y[row, column] - y)
    carried[row, column] = np.nan
    values = carried[rows, columns]
    middle = np.nanmedian(values)
    scatter = 1.482602218505602 * np.nanmedian(np.abs(values - middle))
    return middle, slope_x, slope_y, scatter


@pytest.mark.parametrize("empty", [0.0, 0.05, 0.3])
def test_expectations_equal_plain_numpy(empty):
    """Also where all cells of a window have heights, which goes another way."""
    place_x, place_y, height = scattered(5, empty)
    height += np.random.default_rng(6).normal(0, 0.1, SHAPE)
    got = expect(place_x, place_y, height, radius=2, least_cells=6)
    judged = np.isfinite(got.height)
    assert judged.sum() > 50
    for row, column in zip(*np.nonzero(judged), strict=True):
        want = reference_expectation(place_x, place_y, height, row, column)
        mine = [layer[row, column] for layer in (got.height, got.slope_x, got.slope_y, got.scatter)]
        assert mine == pytest.approx(list(want), abs=1e-13)
    assert np.isnan(got.height[np.isnan(height)]).all()


def test_a_third_of_outliers_does_not_move_an_expectation():
    place = np.zeros(SHAPE)
    ground = 0.1 * COLUMN
    rng = np.random.default_rng(7)
    around = [(r, c) for r in range(2, 7) for c in range(3, 8) if (r, c) != (4, 5)]
    for _ in range(20):
        height = ground.copy()
        for chosen in rng.choice(24, 8, replace=False):
            height[around[chosen]] += 50.0
        height[4, 5] = 77.0
        got = expect(place, place, height, radius=2, least_cells=6)
        assert abs(got.height[4, 5] - ground[4, 5]) < 0.3
        assert got.scatter[4, 5] < 0.6


def test_too_few_neighbours_expect_nothing():
    place = np.zeros(SHAPE)
    height = np.full(SHAPE, np.nan)
    height[4, 2:9] = 1.0
    got = expect(place, place, height, radius=2, least_cells=6)
    assert np.isnan(got.height).all()
    assert np.isfinite(expect(place, place, height, radius=2, least_cells=4).height[4, 5])


def test_support_is_a_neighbour_within_the_steepest_slope():
    height = np.zeros((5, 5))
    height[1, 1], height[3, 3] = 4.0, np.nan
    row, column = np.array([0, 0, 2, 2, 4, 1]), np.array([0, 0, 2, 2, 4, 1])
    value = np.array([4.0 + 1.4, 4.0 + 1.5, 0.9, 2.2, 1.1, 4.0])
    # Steepest 1 per step: across a corner √2 is allowed; an unknown cell is ignored.
    got = count_support(height, row, column, value, 1.0)
    assert list(got) == [1, 0, 6, 0, 0, 0]
