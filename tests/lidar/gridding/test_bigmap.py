"""Bigmaps from returns: planted surfaces, gaps, and the same walk with dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding import (
    GriddingOptions,
    LidarBigmapOptions,
    at_grid_points,
    bigmap_from_returns,
    make_mapola,
)
from lidar.gridding.bigmap import integrate_returns
from lidar.gridding.mapola import LidarBigmap
from lidar.gridding.rejection import RejectionOptions
from lidar.scans import Returns
from spcola.errors import InvalidValueError, SettingsError
from spcola.grids import MapletGrid
from spcola.grids.gaps import bridged_mask
from spcola.heights.slopes import slopes_of, steps_from_slopes

GRID = MapletGrid.facing([180.0, 60.0, -40.0], [1.0, 0.3, -0.2], 0.2, 20)
X, Y = np.meshgrid(GRID.offsets * GRID.gsd, GRID.offsets * GRID.gsd)


def plane(x, y):
    return 0.4 + 0.25 * x - 0.15 * y


def rolling(x, y):
    return 0.2 * x + 0.4 * np.sin(0.9 * x) * np.cos(0.7 * y)


def returns_on(surface, count, seed, noise=0.0, sigma=0.01, grid=GRID):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-grid.half_size - 0.5, grid.half_size + 0.5, (2, count))
    height = surface(x * grid.gsd, y * grid.gsd) + noise * rng.normal(size=count)
    flat = grid.gsd * (x[:, None] * grid.ux + y[:, None] * grid.uy)
    points = grid.center + flat + height[:, None] * grid.uz
    return Returns(points, np.full(count, sigma), np.zeros(count, dtype=int), ("a",))


def without(returns, radius, column=4.0, row=-3.0):
    """Take the returns within `radius` grid steps of a place out."""
    x, y, _ = GRID.project(returns.points)
    return returns.select(np.hypot(x - column, y - row) > radius)


@pytest.mark.parametrize("per_cell", [1.0, 4.0])
def test_a_plane_is_recovered_across_its_gaps(per_cell):
    returns = without(returns_on(plane, int(per_cell * 41**2), 1), 2.2)
    options = LidarBigmapOptions(max_gap=5, tolerance=1e-9, max_rounds=1000)
    result = integrate_returns("B", GRID, returns, options=options)
    bigmap = result.bigmap
    assert result.converged
    assert bigmap.bridged[17, 24]
    # The change of a round is 1e-9 GSD; the slowest mode still has tens of such rounds to go.
    assert np.nanmax(np.abs(bigmap.height - plane(X, Y))) < 1e-7 * GRID.gsd


def test_noise_is_smoothed_and_sigma_covers_the_error():
    returns = returns_on(rolling, 3 * 41**2, 2, noise=0.03, sigma=0.03)
    bigmap = bigmap_from_returns("B", GRID, returns)
    mapola = make_mapola("B", GRID, returns)
    known = mapola.valid
    error = (bigmap.height - rolling(X, Y))[known]
    assert np.std(error) < 0.6 * np.std((mapola.height - rolling(X, Y))[known])
    assert np.abs(error / bigmap.sigma[known]).max() < 3.0
    assert np.array_equal(bigmap.count, mapola.count)
    assert np.array_equal(bigmap.sigma[known], at_grid_points(mapola).sigma[known])


def test_relief_of_few_cells_is_kept():
    """Waves of six cells: the integration makes no height worse on average, and sigma holds."""

    def waves(x, y):
        return 0.3 * np.sin(4.5 * x + y) + 0.2 * np.cos(2 * x - 5.5 * y)

    for per_cell, noise in ((2, 0.02), (8, 0.06)):
        returns = returns_on(waves, per_cell * 41**2, 9, noise=noise, sigma=noise)
        bigmap, mapola = (make("B", GRID, returns) for make in (bigmap_from_returns, make_mapola))
        error = [
            np.std(((m.height - waves(X, Y)) / mapola.sigma)[mapola.valid])
            for m in (bigmap, mapola)
        ]
        assert error[0] < error[1] < 1.3


def test_gaps_are_bridged_with_a_sigma_that_grows_inward():
    returns = without(returns_on(rolling, 6 * 41**2, 3, noise=0.005, sigma=0.005), 3.2)
    bigmap = bigmap_from_returns("B", GRID, returns, options=LidarBigmapOptions(max_gap=8))
    bridged = bigmap.bridged
    assert bridged[17, 24]
    assert (bigmap.count[bridged] == 0).all()
    assert bigmap.sigma[17, 24] > bigmap.sigma[17, 22]
    assert bigmap.sigma[17, 24] > 1.8 * np.median(bigmap.sigma[bigmap.count > 0])
    error = np.abs(bigmap.height - rolling(X, Y))
    assert (error[bridged] < 3 * bigmap.sigma[bridged]).all()


def test_wide_gaps_and_the_outside_stay_unknown():
    returns = without(returns_on(rolling, 6 * 41**2, 4), 6.0)
    x, _, _ = GRID.project(returns.points)
    bigmap = bigmap_from_returns("B", GRID, returns.select(x < 12.4))
    assert np.isnan(bigmap.height[15:20, 22:27]).all()
    assert np.isnan(bigmap.sigma[15:20, 22:27]).all()
    assert not bigmap.valid[:, 33:].any()
    assert bigmap.valid[:, :15].all()


@pytest.mark.parametrize("max_gap", [0, 1, 2, 3, 4])
def test_gaps_up_to_the_stated_width_are_closed(max_gap):
    known = np.ones((12, 30), dtype=bool)
    column = 2
    for width in (1, 2, 3, 4):
        known[:, column : column + width] = False
        column += width + 3
    closed = bridged_mask(known, max_gap)
    column = 2
    for width in (1, 2, 3, 4):
        assert closed[:, column : column + width].all() == (width <= max_gap)
        assert closed[:, column : column + width].any() == (width <= max_gap)
        column += width + 3
    edge = np.zeros((9, 9), dtype=bool)
    edge[2:6, 3:7] = True
    assert np.array_equal(bridged_mask(edge, max_gap), edge)


def test_it_is_the_walk_of_the_paper_with_dense_matrices():
    grid = MapletGrid.facing([180.0, 60.0, -40.0], [1.0, 0.3, -0.2], 0.2, 4)
    returns = returns_on(rolling, 160, 5, noise=0.02, sigma=0.02, grid=grid)
    keep_all = GriddingOptions(rejection=RejectionOptions.none())
    options = LidarBigmapOptions(gridding=keep_all, tolerance=1e-11, max_rounds=2000)
    result = integrate_returns("B", grid, returns, options=options)
    bigmap = result.bigmap
    mapola = make_mapola("B", grid, returns, options=keep_all)
    height = dense_walk(grid, returns.points, mapola, bigmap.valid, result.step_sigma_m)
    assert np.nanmax(np.abs(at_grid_points(mapola).height - mapola.height)) > 1e-4
    assert bigmap.bridged.any()
    assert np.abs(height - bigmap.height)[bigmap.valid].max() < 1e-8


def dense_walk(grid, points, mapola, mask, step_sigma):
    """Iterate energy (A), by its normal matrix, and slope-corrected medians, by loops.

    Constraints hold at grid points: the bending of the mapola is taken off, once.
    """
    flat, mapola = mapola.height, at_grid_points(mapola)
    bend = mapola.height - flat
    x, y, h = grid.project(points)
    column = (np.floor(x + 0.5) + grid.half_size).astype(int)
    row = (np.floor(y + 0.5) + grid.half_size).astype(int)
    number = np.arange(mask.size).reshape(mask.shape)
    pairs_x = [(number[r, c], number[r, c + 1], 0, r, c) for r in range(9) for c in range(8)]
    pairs_y = [(number[r, c], number[r + 1, c], 1, r, c) for r in range(8) for c in range(9)]
    pairs = [p for p in pairs_x + pairs_y if mask.flat[p[0]] and mask.flat[p[1]]]
    weight = np.where(mapola.valid, 1 / mapola.sigma**2, 0.0)
    constraint, slopes = mapola.height.copy(), (np.zeros(mask.shape), np.zeros(mask.shape))
    inside, height = np.flatnonzero(mask), np.zeros(mask.shape)
    for _ in range(1000):
        steps = steps_from_slopes(*slopes, grid.gsd)
        matrix = np.diag(weight.ravel())
        right = (weight * np.nan_to_num(constraint)).ravel()
        for a, b, axis, r, c in pairs:
            for i, j, sign in ((a, b, -1), (b, a, 1)):
                matrix[i, i] += step_sigma**-2
                matrix[i, j] -= step_sigma**-2
                right[i] += sign * step_sigma**-2 * steps[axis][r, c]
        before, height = height, np.full(mask.shape, np.nan)
        height[mask] = np.linalg.solve(matrix[np.ix_(inside, inside)], right[inside])
        if np.nanmax(np.abs(height - before)) < 1e-10:
            break
        slopes = tuple(np.nan_to_num(s) for s in slopes_of(height, grid.gsd))
        for r, c in zip(*np.nonzero(mapola.valid), strict=True):
            mine = (row == r) & (column == c)
            back_x, back_y = c - grid.half_size - x[mine], r - grid.half_size - y[mine]
            lift = grid.gsd * (slopes[0][r, c] * back_x + slopes[1][r, c] * back_y)
            constraint[r, c] = np.median(h[mine] + lift) + bend[r, c]
    return height


def test_the_order_of_the_returns_changes_nothing():
    returns = returns_on(rolling, 4000, 6, noise=0.02, sigma=0.02)
    one = bigmap_from_returns("B", GRID, returns)
    order = np.random.default_rng(7).permutation(len(returns))
    other = bigmap_from_returns("B", GRID, returns.select(order))
    assert np.array_equal(one.height, other.height, equal_nan=True)
    assert np.array_equal(one.sigma, other.sigma, equal_nan=True)


def test_no_returns_give_no_heights():
    result = integrate_returns("B", GRID, returns_on(plane, 0, 8))
    assert not result.bigmap.valid.any()
    assert result.converged


def test_layers_and_options_are_checked():
    height = np.zeros(GRID.shape)
    assert LidarBigmap("B", GRID, height).bridged.all()
    with pytest.raises(InvalidValueError, match=r"B\.count"):
        LidarBigmap("B", GRID, height, count=np.zeros((3, 3)))
    with pytest.raises(InvalidValueError, match=r"B\.spread"):
        LidarBigmap("B", GRID, height, spread=np.zeros((3, 3)))
    for change in ({"max_gap": -1}, {"tolerance": 0.0}, {"max_rounds": 0}):
        with pytest.raises(SettingsError, match=next(iter(change))):
            LidarBigmapOptions(**change)
