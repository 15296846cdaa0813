from __future__ import annotations

import numpy as np
import pytest

from fusion.scaling.fit.observation import uniform_displacements
from fusion.scaling.geometry import maplet_shares
from fusion.scaling.geometry.sharing import ground_in_common, patterns, shared_matches
from fusion.scaling.pairs.response import cell_means, surface_response
from fusion.surfacematch import MatchOptions, Surface, match_surfaces
from spcola.grids import Maplet, MapletGrid

GRID = MapletGrid.facing([60.0, 20.0, 10.0], [3.0, 1.0, 0.5], 0.5, 40)


def relief(y, x):
    """Hills of some decimetres on grid steps, rounded as a body is."""
    hills = 0.5 * np.sin(y / 5.3) * np.cos(x / 6.7) + 0.3 * np.sin(x / 4.1 + 0.3 * y)
    return hills - 5e-3 * (x**2 + y**2) * GRID.gsd**2


def along(grid, east_steps):
    """A grid of the same size, so many steps further along Uy."""
    return MapletGrid(grid.center + east_steps * grid.gsd * grid.uy, grid.axes, grid.gsd, 40)


def test_shares_of_maplets_are_those_of_the_ground():
    west, east = along(GRID, -61), along(GRID, 20)
    flat = np.zeros(GRID.shape)
    shares = maplet_shares(GRID, flat, [Maplet("W", west, flat), Maplet("E", east, flat)])
    # Of 81 columns the western one reaches 20, the eastern one 61; they do not overlap.
    np.testing.assert_allclose(shares, [20 / 81, 61 / 81])
    both = maplet_shares(GRID, flat, [Maplet("A", GRID, flat), Maplet("B", GRID, flat)])
    np.testing.assert_allclose(both, [0.5, 0.5])


def test_a_bigmap_without_maplets_leans_on_none():
    assert maplet_shares(GRID, np.full(GRID.shape, np.nan), []).shape == (0,)


def test_ground_in_common_is_that_of_the_squares():
    turned = MapletGrid(GRID.center, -GRID.axes * [[1], [-1], [1]], GRID.gsd, 40)
    common = ground_in_common([GRID, along(GRID, 20.25), along(GRID, 81), turned])
    np.testing.assert_allclose(common[0], [1.0, 0.75, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(common, common.T)


def test_patterns_do_what_their_sources_do():
    generator = np.random.default_rng(1)
    shares = np.repeat(generator.dirichlet(np.ones(4), 5), 3, axis=0)
    displaced = uniform_displacements(np.hstack([shares, 1e-4 * np.eye(15)]))
    fewer = patterns(displaced)
    assert fewer.shape[2] == 12
    rows, kept = displaced.reshape(45, -1), fewer.reshape(45, -1)
    np.testing.assert_allclose(kept @ kept.T, rows @ rows.T, atol=1e-7)


def test_matches_over_one_ground_are_one_match():
    covariance = np.array([np.diag([4e-4, 9e-4, 1e-4])] * 4)
    common = np.eye(4)
    common[:3, :3] = 1.0
    displaced, own = shared_matches(common, covariance)
    rows = displaced.reshape(12, -1)
    total = rows @ rows.T
    np.testing.assert_allclose(total[:3, :3], covariance[0], atol=1e-12)
    np.testing.assert_allclose(total[:3, 6:9], covariance[0], atol=1e-12)
    np.testing.assert_allclose(own[:3], 0.0, atol=1e-12)
    # The one that lies elsewhere shares nothing.
    np.testing.assert_allclose(own[3], covariance[3])
    np.testing.assert_allclose(total[9:], 0.0, atol=1e-12)


def test_a_source_that_moves_everything_moves_the_match_by_its_share():
    y, x = np.meshgrid(GRID.offsets, GRID.offsets, indexing="ij")
    shares = np.full((*GRID.shape, 2), [0.3, 0.7])
    response = surface_response(GRID, relief(y, x), np.full(GRID.shape, 0.01), shares)
    np.testing.assert_allclose(response[0], 0.3 * np.eye(3), atol=1e-10)
    np.testing.assert_allclose(response[1], 0.7 * np.eye(3), atol=1e-10)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_the_match_finds_of_a_bent_square_is_the_response(axis):
    """Three states a scan: the middle one is off, and bends the surface along the lines."""
    y, x = np.meshgrid(GRID.offsets, GRID.offsets, indexing="ij")
    share = 1.0 - np.abs(y + 12.0) / 60.0
    height = relief(y, x)
    response = surface_response(
        GRID, height, np.full(GRID.shape, np.nan), np.stack([share, 1.0 - share], axis=2)
    )
    moved = 0.02 * np.eye(3)[axis]
    local = GRID.axes @ moved
    slope_y, slope_x = np.gradient(height, GRID.gsd)
    bent = height + share * (local[2] - slope_x * local[0] - slope_y * local[1])
    match = match_surfaces(
        "bent", GRID, Surface(bent), Surface(height), options=MatchOptions(capture_m=1.0)
    )
    np.testing.assert_allclose(-match.displacement, response[0] @ moved, atol=1e-3)
    # The match is robust; plain least squares find the response exactly.
    columns = [-slope_x, -slope_y, np.ones(GRID.shape), x, y]
    partials = np.stack([each.ravel() for each in columns], axis=1)
    found = np.linalg.lstsq(partials, (bent - height).ravel())[0][:3]
    np.testing.assert_allclose(GRID.axes.T @ found, response[0] @ moved, atol=1e-9)


def test_flat_ground_leaves_the_mean_share():
    shares = np.full((*GRID.shape, 1), 0.4)
    response = surface_response(GRID, np.zeros(GRID.shape), np.ones(GRID.shape), shares)
    np.testing.assert_allclose(response[0], 0.4 * np.eye(3))


def test_cells_hold_the_mean_of_their_points():
    points = GRID.center + 0.5 * np.array([[0.1, 0.2, 0.0], [0.3, -0.4, 0.0], [3.0, 1.0, 0.0]])
    local = points - GRID.center
    means = cell_means(GRID, GRID.center + local @ GRID.axes, np.array([[1.0], [3.0], [7.0]]))
    assert means.shape == (*GRID.shape, 1)
    assert means[40, 40, 0] == 2.0
    assert means[41, 43, 0] == 7.0
    assert np.count_nonzero(np.isfinite(means)) == 2
