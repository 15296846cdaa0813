from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.camera import project_image
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.photometry import ortho_rectify, view_of
from spcola.photometry.ortho_image import footprint_of
from spcola.shape import Mesh, RayCaster

NADIR, LIGHT = [0.0, 0.0, 1.0], [0.6, 0.2, 0.8]


def ramp(image):
    """The image with brightness 1000 + 3 pixel + 7 line."""
    line, pixel = np.indices((image.camera.height, image.camera.width)) + 1.0
    return replace(image, pixels=1000.0 + 3.0 * pixel + 7.0 * line)


@pytest.mark.parametrize("pixel", [0.11, 0.3, 0.5, 1.3])
def test_a_ramp_is_read_where_points_are_projected(waves, pixel):
    image = ramp(waves.photograph("A", [0.3, 0.1, 1.0], LIGHT, pixel=pixel, samples=1, size=200))
    height = waves.heights()
    view = view_of(image, waves.grid, height)
    found = ortho_rectify(image, view)
    column, line = project_image(image, waves.grid.points(height))
    away = view.seen & (np.minimum(column, line) > 12) & (np.maximum(column, line) < 188)
    assert away.sum() > 300
    expected = 1000.0 + 3.0 * column + 7.0 * line
    np.testing.assert_allclose(found.brightness[away], expected[away], atol=0.02)
    assert np.isnan(found.brightness[~view.seen]).all()


def test_pixels_smaller_than_a_cell_are_averaged(waves):
    image = waves.photograph("A", NADIR, LIGHT, pixel=0.1, samples=1, size=400)
    checks = np.indices((400, 400)).sum(axis=0) % 2 * 200.0 + 1000.0
    flat = np.zeros(waves.grid.shape)
    found = ortho_rectify(
        replace(image, pixels=checks), view_of(image, waves.grid, flat)
    ).brightness
    assert np.nanstd(found) < 8.0
    assert np.nanmean(found) == pytest.approx(1100.0, abs=2.0)


def test_the_footprint_is_the_projection_of_a_step(waves):
    image = waves.photograph("A", [0.5, -0.2, 1.0], LIGHT, samples=1)
    center, step = waves.grid.center, 1e-3
    for axis, along in enumerate((waves.grid.ux, waves.grid.uy)):
        ends = [project_image(image, center + s * step * along) for s in (0.5, -0.5)]
        numeric = (np.array(ends[0]) - ends[1]) / step * waves.grid.gsd
        np.testing.assert_allclose(
            footprint_of(image, waves.grid)[:, axis], numeric, rtol=1e-4, atol=1e-8
        )


def test_a_wall_hides_and_shades_what_lies_behind_it(waves):
    grid, height = waves.grid, np.zeros(waves.grid.shape)
    height[:, 30:32] = 2.0
    image = waves.photograph("A", [1.0, 0.0, 1.0], [-1.0, 0.0, 2.0], samples=1)
    view = view_of(image, grid, height)
    # Seen from +x at 45°, two metres hide two metres (four cells) at its −x side; the Sun from −x,
    # at half that slope's tangent, leaves one metre dark on the other side.
    row = view.seen[30]
    assert not row[26:30].any()
    assert row[10:25].all()
    assert row[33:50].all()
    assert not view.lit[30, 32]
    assert view.lit[30, 36:50].all()
    assert view.lit[30, 10:28].all()


def test_other_ground_stands_in_the_way_but_not_from_within(waves):
    grid, flat = waves.grid, np.zeros(waves.grid.shape)
    image = waves.photograph("A", NADIR, [1.0, 0.0, 0.3], samples=1)

    def screen(x):
        """A large wall across Ux at x metres, facing the grid."""
        corners = np.array([[x, -99, -50], [x, 99, -50], [x, 99, 80], [x, -99, 80]])
        facets = [[0, 2, 1], [0, 3, 2]]
        return RayCaster(Mesh(grid.center + corners @ grid.axes, facets))

    assert view_of(image, grid, flat).lit.all()
    assert not view_of(image, grid, flat, beyond=screen(40.0)).lit.any()
    # A wall over the grid itself is the coarser picture of this ground.
    assert view_of(image, grid, flat, beyond=screen(5.0)).lit[1:-1].all()
    turned = Mesh(screen(40.0).mesh.vertices, screen(40.0).mesh.facets[:, ::-1])
    assert view_of(image, grid, flat, beyond=RayCaster(turned)).lit.all()


def test_ground_that_hangs_over_the_grid_shades_and_hides_it(waves):
    grid, flat = waves.grid, np.zeros(waves.grid.shape)
    image = waves.photograph("A", NADIR, [0.05, 0.0, 1.0], samples=1)

    def roof(height):
        """A large plate over the grid, facing it: the other lobe of a body."""
        corners = np.array([[-99, -99, height], [-99, 99, height], [99, 99, height]])
        return RayCaster(Mesh(grid.center + corners @ grid.axes, [[0, 1, 2]]))

    dark = view_of(image, grid, flat, beyond=roof(0.9 * grid.radius))
    # Half of the plate is missing: that is lit, and seen.
    x, y = np.meshgrid(grid.offsets, grid.offsets)
    assert not dark.lit[y > x + 8].any()
    assert not dark.seen[y > x + 8].any()
    assert dark.lit[y < x - 8].all()
    # A little higher than the ground it is a coarse picture of it.
    assert view_of(image, grid, flat, beyond=roof(0.1 * grid.radius)).lit[1:-1].all()


def test_thresholds_frame_and_geometry(waves):
    image = waves.photograph("A", NADIR, LIGHT, samples=1, size=30)
    pixels = np.full((30, 30), 500)
    pixels[:10], pixels[20:] = 50, 65001
    view = view_of(image, waves.grid, np.zeros(waves.grid.shape))
    found = ortho_rectify(replace(image, pixels=pixels), view)
    assert view.seen.sum() == pytest.approx(900, abs=70)
    assert found.exposed.sum() == pytest.approx(300, abs=40)
    assert found.saturated.sum() == pytest.approx(300, abs=40)
    sun = waves.grid.axes @ image.sun
    np.testing.assert_allclose(view.cos_incidence, sun[2], atol=1e-12)
    np.testing.assert_allclose(view.cos_emission, 1.0, atol=1e-4)
    np.testing.assert_allclose(view.phase, np.arccos(sun[2]), atol=0.02)


def test_what_cannot_be_done_is_refused(waves):
    image = waves.photograph("A", NADIR, LIGHT, samples=1)
    flat = np.zeros(waves.grid.shape)
    view = view_of(image, waves.grid, flat)
    with pytest.raises(InvalidValueError, match="no pixels"):
        ortho_rectify(replace(image, pixels=None), view)
    behind = MapletGrid.facing(image.position * 2.0, image.position, 0.5, 5)
    with pytest.raises(InvalidValueError, match="behind the camera"):
        view_of(image, behind, np.zeros(behind.shape))
