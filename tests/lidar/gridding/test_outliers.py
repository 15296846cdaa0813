"""Which returns are left out of a mapola."""

from __future__ import annotations

import numpy as np
import pytest
from made_returns import GRID, X, Y, lifted, plane, returns_on, rolling

from lidar.gridding import grid_returns, make_mapola
from lidar.scans import Returns


@pytest.mark.parametrize("per_cell", [1.5, 3.0, 8.0])
def test_outliers_are_rejected_and_little_else(per_cell):
    rng = np.random.default_rng(15)
    count = int(per_cell * 61**2)
    returns, outlier = returns_on(rolling, count, rng, noise=0.01, sigma=0.01, outliers=0.005)
    result = grid_returns("A", GRID, returns)
    x, y, height = GRID.project(returns.points)
    gross = outlier & (np.abs(height - rolling(x * GRID.gsd, y * GRID.gsd)) > 4 * GRID.gsd)
    assert gross.sum() > 10
    assert not (result.used & gross).any()
    lost = ~result.used & ~outlier
    assert lost.mean() < 1e-3
    report = result.report
    assert report.used == result.used.sum()
    assert report.offered == report.used + report.ignored + report.isolated + report.outlying
    filled = np.zeros(GRID.shape, dtype=bool)
    inside = np.abs(np.floor([y + 0.5, x + 0.5])).max(axis=0) <= GRID.half_size
    cell = np.floor([y[inside] + 30.5, x[inside] + 30.5]).astype(int)
    filled[cell[0], cell[1]] = True
    assert report.emptied == filled.sum() - result.mapola.valid.sum()


def test_outliers_beyond_the_edge_of_a_raster_are_rejected():
    rng = np.random.default_rng(18)
    dense, _ = returns_on(rolling, 12 * 61**2, rng, noise=0.01, sigma=0.01)
    x = GRID.project(dense.points)[0]
    lone = rng.uniform([2.0, -30.0, -2.0], [30.0, 30.0, 2.0], (40, 3))
    outliers = lifted(GRID, lone[:, 0], lone[:, 1], lone[:, 2])
    points = np.concatenate([dense.points[x < 0.0], outliers])
    count = len(points)
    half = Returns(points, np.full(count, 0.01), np.zeros(count, dtype=np.int32), ("a",))
    result = grid_returns("A", GRID, half)
    assert not result.used[-40:].any()
    assert result.used[:-40].mean() > 0.999
    assert np.isnan(result.mapola.height[:, 33:]).all()


def test_outliers_side_by_side_beyond_the_edge_do_not_support_each_other():
    rng = np.random.default_rng(31)
    raster, _ = returns_on(plane, 12 * 61**2, rng, noise=0.003)
    x, _, _ = GRID.project(raster.points)
    # A rim of single returns, two cells wide, is ground; two outliers beyond it are not.
    rim_x, rim_y = np.repeat([10.9, 11.9], 40), np.tile(np.arange(-20.0, 20.0), 2)
    rim = lifted(GRID, rim_x, rim_y, plane(rim_x * GRID.gsd, rim_y * GRID.gsd))
    outliers = lifted(GRID, np.array([17.0, 18.0]), np.zeros(2), np.array([-2.0, -1.98]))
    points = np.concatenate([raster.points[x < 10.5], rim, outliers])
    returns = Returns(
        points, np.full(len(points), np.nan), np.zeros(len(points), dtype=np.int32), ("a",)
    )
    gridding = grid_returns("A", GRID, returns)
    assert not gridding.used[-2:].any()
    assert gridding.used[-2 - len(rim) : -2].all()


def test_an_isolated_return_next_to_a_track_does_not_tilt_it():
    """In a grid that is dense elsewhere: the track alone does not determine a slope across."""
    rng = np.random.default_rng(32)
    raster, _ = returns_on(plane, 20 * 61**2, rng, noise=0.01)
    x, _, _ = GRID.project(raster.points)
    along = np.linspace(-25.0, 25.0, 500)
    across = 18.0 + 0.19 * along
    track = lifted(GRID, across, along, plane(across * GRID.gsd, along * GRID.gsd))
    track += 0.01 * rng.normal(size=(len(track), 1)) * GRID.uz
    # Where the track changes its column, its only two steps across are at the isolated return.
    outlier = lifted(GRID, np.array([17.2]), np.array([3.0]), np.array([-1.2]))
    points = np.concatenate([raster.points[x < 0.0], track, outlier])
    returns = Returns(
        points, np.full(len(points), 0.01), np.zeros(len(points), dtype=np.int32), ("a",)
    )
    gridding = grid_returns("A", GRID, returns)
    assert not gridding.used[-1]
    error = (gridding.mapola.height - plane(X, Y))[:, 41:]
    # Without a slope across it, a height may miss by half a cell of the plane's tilt.
    assert np.nanmax(np.abs(error)) < 0.05


def test_shots_far_apart_are_not_rejected():
    rng = np.random.default_rng(19)
    returns, _ = returns_on(rolling, 120, rng, noise=0.01, sigma=0.01)
    result = grid_returns("A", GRID, returns)
    assert result.report.isolated == 0
    assert result.mapola.valid.sum() > 110


def test_boulders_stay():
    """Three cells across and three high: steep, but neighbours agree.

    The plane through the step costs the rim up to half a cell of its slope.
    """

    def ground(x, y):
        return np.where(np.maximum(np.abs(x - 0.5), np.abs(y + 0.8)) < 0.15, 0.3, 0.0)

    rng = np.random.default_rng(16)
    returns, _ = returns_on(ground, 2 * 61**2, rng, noise=0.003, sigma=0.003)
    result = grid_returns("A", GRID, returns)
    assert result.report.isolated == 0
    assert np.nanmin(result.mapola.height[21:24, 34:37]) > 0.2


def test_a_second_sheet_far_from_the_surface_is_left_out():
    rng = np.random.default_rng(17)
    returns, _ = returns_on(plane, 8 * 61**2, rng, noise=0.005, sigma=0.005)
    over = rng.random(len(returns)) < 0.3
    points = returns.points + np.where(over, 1.5, 0.0)[:, None] * GRID.uz
    doubled = Returns(points, returns.sigma, returns.scan, returns.scan_names)
    result = grid_returns("A", GRID, doubled)
    dense = result.mapola.count >= 5
    assert not (result.used & over).sum() > 0.01 * over.sum()
    assert np.median(np.abs(result.mapola.height - plane(X, Y))[dense]) < 0.005


def test_the_far_side_and_the_surroundings_are_ignored():
    rng = np.random.default_rng(18)
    near, _ = returns_on(rolling, 5000, rng, noise=0.01, sigma=0.01)
    far = near.points - 100.0 * GRID.uz
    off_side = near.points + 7.0 * GRID.ux
    points = np.concatenate([near.points, far, off_side])
    both = Returns(points, np.tile(near.sigma, 3), np.tile(near.scan, 3), near.scan_names)
    result = grid_returns("A", GRID, both)
    assert np.array_equal(result.mapola.height, make_mapola("A", GRID, near).height, equal_nan=True)
    assert result.report.ignored == 10_000
