"""Projection between grids: planes, quadratics, rotations, folds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.formats.maplets import read_maplet
from spcola.grids import Maplet, MapletGrid, project_maplet, project_window
from spcola.heights.slopes import slopes_of


def turned_grid(tilt_deg, *, gsd=1.0, half_size=20, shift=(0.0, 0.0, 0.0), spin_deg=0.0):
    axes = Rotation.from_euler(
        "xyz", [tilt_deg, -0.7 * tilt_deg, spin_deg], degrees=True
    ).as_matrix()
    return MapletGrid(np.array([0.0, 0.0, 250.0]) + shift, axes.T, gsd, half_size)


def on_surface(grid, surface):
    """Heights of `surface` z(x, y), body-fixed, above the points of `grid` (by bisection)."""
    low, high = np.full(grid.shape, -60.0), np.full(grid.shape, 60.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        points = grid.points(middle)
        above = points[..., 2] > surface(points[..., 0], points[..., 1])
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


def quadratic(x, y):
    return 250.0 + 0.004 * x**2 - 0.003 * y**2 + 0.002 * x * y + 0.1 * x


def test_onto_itself_is_the_identity():
    rng = np.random.default_rng(0)
    grid = turned_grid(25.0, half_size=12, gsd=0.3)
    height = rng.normal(0, 0.5, grid.shape)
    height[4, 7] = np.nan
    source = Maplet("A", grid, height, 1 + 0.1 * rng.random(grid.shape), rng.random(grid.shape))
    out = project_maplet(source, grid)
    np.testing.assert_allclose(out.height, np.where(out.valid, height, np.nan), atol=1e-9)
    # A point all of whose cells have a known corner is kept; the missing one has no height.
    assert np.array_equal(out.valid, np.isfinite(height))
    np.testing.assert_allclose(out.albedo[out.valid], source.albedo[out.valid], atol=1e-9)
    np.testing.assert_allclose(out.sigma[out.valid], source.sigma[out.valid], atol=1e-9)
    slope_x, slope_y = slopes_of(height, grid.gsd)
    whole = np.zeros(grid.shape, dtype=bool)
    whole[7:, 10:] = True
    np.testing.assert_allclose(out.slope_x[whole], slope_x[whole], atol=1e-6)
    np.testing.assert_allclose(out.slope_y[whole], slope_y[whole], atol=1e-6)


@pytest.mark.parametrize("tilt", [0.0, 10.0, 30.0])
def test_plane_is_exact_in_any_frame(tilt):
    source_grid = turned_grid(tilt, shift=(1.3, -0.4, 2.0), spin_deg=33.0)
    x, y = np.meshgrid(source_grid.offsets, source_grid.offsets)
    source = Maplet(
        "A", source_grid, 0.2 * x - 0.1 * y, 1 + 0.01 * x, np.full(source_grid.shape, 0.05)
    )
    grid = turned_grid(0.0, gsd=0.7, half_size=15)
    out = project_maplet(source, grid)
    normal = np.cross(source_grid.ux + 0.2 * source_grid.uz, source_grid.uy - 0.1 * source_grid.uz)
    normal = normal @ grid.axes.T
    assert out.valid.mean() > 0.9
    points = grid.points(out.height)[out.valid]
    u, v, h = source_grid.project(points)
    np.testing.assert_allclose(h, 0.2 * u - 0.1 * v, atol=1e-10)
    np.testing.assert_allclose(out.albedo[out.valid], 1 + 0.01 * u, atol=1e-10)
    np.testing.assert_allclose(out.slope_x[out.valid], -normal[0] / normal[2], atol=1e-10)
    np.testing.assert_allclose(out.slope_y[out.valid], -normal[1] / normal[2], atol=1e-10)
    lifted = project_maplet(source.with_layers(height=source.height + 1e-3), grid)
    both = out.valid & lifted.valid
    np.testing.assert_allclose(
        out.sigma[both], 50.0 * (lifted.height - out.height)[both], rtol=1e-8
    )


def test_quadratic_surface_between_rotated_grids():
    source_grid = turned_grid(15.0, gsd=0.5, half_size=60, spin_deg=20.0)
    grid = turned_grid(-5.0, gsd=0.7, half_size=20)
    source = Maplet("A", source_grid, on_surface(source_grid, quadratic))
    out = project_maplet(source, grid)
    expected = on_surface(grid, quadratic)
    assert out.valid.all()
    # Bilinear cells miss a curvature of 0.01/m by at most gsd²/8 times the sum of both.
    assert np.abs(out.height - expected).max() < 0.5**2 / 8 * 0.02
    slope_x, slope_y = slopes_of(expected, grid.gsd)
    inner = (slice(1, -1), slice(1, -1))
    assert np.abs(out.slope_x - slope_x)[inner].max() < 0.5 * 0.5 * 0.015
    assert np.abs(out.slope_y - slope_y)[inner].max() < 0.5 * 0.5 * 0.015
    assert abs(np.mean((out.slope_x - slope_x)[inner])) < 2e-4


def test_two_ways_of_halving_the_error():
    """Interpolation error falls with the square of the source's GSD."""
    grid = turned_grid(-5.0, gsd=0.7, half_size=10)
    expected = on_surface(grid, quadratic)
    worst = []
    for gsd in (1.0, 0.5):
        source_grid = turned_grid(15.0, gsd=gsd, half_size=round(20 / gsd), spin_deg=20.0)
        source = Maplet("A", source_grid, on_surface(source_grid, quadratic))
        worst.append(np.abs(project_maplet(source, grid).height - expected).max())
    assert 3.0 < worst[0] / worst[1] < 5.0


def test_far_side_is_skipped():
    grid = turned_grid(0.0)
    for angle in (90.0, 135.0, 180.0):
        axes = Rotation.from_euler("x", angle, degrees=True).as_matrix().T
        away = Maplet("A", MapletGrid(grid.center, axes, 1.0, 20), np.zeros(grid.shape))
        assert not project_maplet(away, grid).valid.any()


def test_folded_cells_are_skipped_and_the_outermost_sheet_counts():
    """An overhang: a step that leans over in the target frame."""
    source_grid = MapletGrid(
        [0.0, 0.0, 250.0], Rotation.from_euler("y", 30, degrees=True).as_matrix().T, 1.0, 20
    )
    height = np.where(source_grid.offsets > 0, 8.0, 0.0) * np.ones((41, 1))
    grid = MapletGrid([0.0, 0.0, 250.0], np.eye(3), 1.0, 20)
    out = project_maplet(Maplet("A", source_grid, height), grid)
    assert (np.abs(out.slope_x[out.valid]) < 10).all()
    for sign, source in ((1, height), (-1, 8.0 - height)):
        out = project_maplet(Maplet("A", source_grid, source), grid)
        points = source_grid.points(source)
        x, _, z = grid.project(points[20])
        column = grid.half_size
        for n in range(-10, 11):
            sheets = [
                z[k] + (n - x[k]) / (x[k + 1] - x[k]) * (z[k + 1] - z[k])
                for k in range(40)
                if x[k] < x[k + 1] and x[k] - 1e-9 <= n <= x[k + 1] + 1e-9
            ]
            if sheets:
                assert out.height[column, column + n] == pytest.approx(max(sheets), abs=1e-9), sign
            else:
                assert np.isnan(out.height[column, column + n])


def test_window_is_the_part_of_the_grid_that_is_reached():
    grid = turned_grid(0.0, half_size=60)
    source = Maplet("A", turned_grid(10.0, half_size=8, shift=(20.0, 5.0, 0.0)), np.zeros((17, 17)))
    window, whole = project_window(source, grid), project_maplet(source, grid)
    assert window.height.shape == np.empty(grid.shape)[window.rows, window.columns].shape
    assert window.height.size < 500
    np.testing.assert_array_equal(whole.height[window.rows, window.columns], window.height)
    assert whole.valid.sum() == window.valid.sum() > 100
    far = Maplet("B", turned_grid(0.0, half_size=8, shift=(200.0, 0.0, 0.0)), np.zeros((17, 17)))
    assert project_window(far, grid).height.size == 0
    nothing = Maplet("C", grid, np.full(grid.shape, np.nan))
    assert not project_maplet(nothing, grid).valid.any()


@pytest.mark.real_data
def test_real_maplet_onto_itself(shared_data):
    """Its unknown points remain unknown, all others keep their height."""
    source = read_maplet(shared_data / "bennu" / "OLA001.MAP")
    out = project_maplet(source, source.grid)
    assert not (out.valid & ~source.valid).any()
    # A point without a whole cell next to it cannot be interpolated.
    lost = source.valid & ~out.valid
    assert lost.sum() <= 40
    np.testing.assert_allclose(
        out.height[out.valid], source.height[out.valid], atol=1e-5 * source.grid.gsd
    )
