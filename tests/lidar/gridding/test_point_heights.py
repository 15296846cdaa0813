"""Mean heights of cells brought to grid points: boulders regain their tops, noise is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding import Mapola, at_grid_points, make_mapola
from lidar.gridding.point_heights import bending_variance
from lidar.scans import Returns
from spcola.grids import MapletGrid

GRID = MapletGrid.facing([200.0, 50.0, 30.0], [1.0, 0.2, 0.1], 0.5, 30)
X, Y = np.meshgrid(GRID.offsets * GRID.gsd, GRID.offsets * GRID.gsd)


def domes(x, y, radius=1.5, apart=6.0):
    """Caps of spheres, 1.1 m high, on a plane."""
    u, v = (np.mod(each, apart) - 0.5 * apart for each in (x, y))
    cap = np.sqrt(np.maximum(radius**2 - u**2 - v**2, 0.0))
    return np.maximum(cap - 0.4, 0.0)


def mapola_of(surface, per_cell, noise, seed):
    rng = np.random.default_rng(seed)
    count = per_cell * GRID.size**2
    x, y = rng.uniform(-30.5, 30.5, (2, count)) * GRID.gsd
    height = surface(x, y) + noise * rng.normal(size=count)
    points = GRID.center + x[:, None] * GRID.ux + y[:, None] * GRID.uy + height[:, None] * GRID.uz
    returns = Returns(points, np.full(count, noise), np.zeros(count, dtype=np.int32), ("a",))
    return make_mapola("A", GRID, returns)


def test_tops_that_cells_flatten_are_restored():
    truth = domes(X, Y)
    top = truth > 0.9
    raw = mapola_of(domes, 8, 0.02, 1)
    points = at_grid_points(raw)
    before, after = (m.height - truth for m in (raw, points))
    assert np.mean(before[top]) < -0.012
    assert abs(np.mean(after[top])) < 0.35 * abs(np.mean(before[top]))
    assert np.sqrt(np.nanmean(after**2)) < np.sqrt(np.nanmean(before**2))
    assert np.nanmax(points.sigma / raw.sigma) < 1.0 + 1e-12


def test_sigma_covers_what_boulders_do_inside_cells():
    inside = {"raw": [], "points": []}
    for seed in range(3):
        raw = mapola_of(domes, 6, 0.02, 10 + seed)
        truth = domes(X, Y)
        for name, mapola in (("raw", raw), ("points", at_grid_points(raw))):
            pull = np.abs(mapola.height - truth) / mapola.sigma
            inside[name].append(pull[truth > 0.05])
    for name, pulls in inside.items():
        pull = np.concatenate(pulls)
        assert 0.58 < np.mean(pull < 1.0) < 0.85, name
        assert np.mean(pull < 2.0) > 0.88, name


def test_even_ground_keeps_its_heights_and_sigmas():
    def plane(x, y):
        return 0.3 * x - 0.1 * y

    raw = mapola_of(plane, 5, 0.03, 4)
    points = at_grid_points(raw)
    moved = (points.height - raw.height) / raw.sigma
    assert np.sqrt(np.nanmean(moved**2)) < 0.05
    np.testing.assert_allclose(points.sigma, raw.sigma, rtol=0.15)
    assert np.nanmedian(points.sigma / raw.sigma) > 0.999


def test_what_is_unknown_stays_so_and_bends_nothing():
    height = np.full(GRID.shape, np.nan)
    height[10:20, 10:20] = 0.2 * X[10:20, 10:20] ** 2
    sigma = np.where(np.isfinite(height), 0.01, np.nan)
    mapola = Mapola("A", GRID, height, sigma=sigma, count=np.isfinite(height).astype(int))
    points = at_grid_points(mapola)
    assert np.array_equal(points.valid, mapola.valid)
    border = points.valid.copy()
    border[11:19, 11:19] = False
    np.testing.assert_array_equal(points.height[border], height[border])
    # h_xx = 0.4 per metre: over a cell of half a metre its mean exceeds the middle by 0.4 / 96.
    # A border without known bending around it takes that of its neighbourhood.
    lowered = (height - points.height)[13:17, 13:17]
    assert lowered == pytest.approx(np.full((4, 4), 0.4 / 96.0), rel=0.2)
    assert np.all(bending_variance(height, sigma**2)[~mapola.valid] >= 0.0)


def test_no_height_is_lost_next_to_wide_gaps_and_nothing_warns(recwarn):
    rng = np.random.default_rng(6)
    height = 0.05 * rng.normal(size=GRID.shape)
    height[:, 5:40] = np.nan
    height[3:50, 42:] = np.nan
    sigma = np.where(np.isfinite(height), 0.02, np.nan)
    mapola = Mapola("A", GRID, height, sigma=sigma, count=np.isfinite(height).astype(int))
    points = at_grid_points(mapola)
    assert np.array_equal(points.valid, mapola.valid)
    assert np.array_equal(np.isfinite(points.sigma), mapola.valid)
    assert not recwarn.list
