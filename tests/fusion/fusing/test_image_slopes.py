"""Which images lit a maplet, and what fused heights make of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fusion.fusing.uncertainty import AlignedHeights, ImageSlopes, estimate_information
from fusion.fusing.uncertainty.spc_errors import light_along_edges
from spcola.camera import Camera, SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.photometry import SlopeVariance

CAMERA = Camera(100.0, [50.5, 50.5], [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0]], 100, 100)
RADIUS, DISTANCE = 80.0, 1000.0
# Cells of a grid of 99 x 99 points.
CELLS = (98, 98)


def facing(longitude):
    angle = np.radians(longitude)
    normal = np.array([np.cos(angle), np.sin(angle), 0.0])
    return MapletGrid.facing(RADIUS * normal, normal, 0.5, 10)


def image_of(longitude, sun, number=0):
    """An image from 1 km above a longitude, 25 m wide on the ground."""
    grid = facing(longitude)
    look = -grid.uz
    across = np.cross(grid.uy, look)
    axes = np.stack([across, np.cross(look, across), look])
    position = (RADIUS + DISTANCE) * grid.uz
    return SpcImage(f"I{number:03}", "2019 JAN 01", CAMERA, -position, axes, np.asarray(sun))


def suns(longitude, count, polar=35.0):
    """Suns around the vertical of a longitude."""
    grid = facing(longitude)
    for azimuth in np.linspace(0.0, 2 * np.pi, count, endpoint=False):
        tilt = np.radians(polar)
        local = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)]
        yield np.array(local) @ grid.axes


def test_only_images_that_look_at_a_maplet_face_it():
    images = tuple(image_of(lon, next(suns(lon, 1)), n) for n, lon in enumerate((0, 1, 60, 180)))
    framed = ImageSlopes(images, "images")
    assert {i.name for i in framed.facing(facing(0.0))} == {"I000", "I001"}
    # From 1 km above 60° the ground at 0° is above the horizon; from 180° it is not.
    light = ImageSlopes(images, "sun")
    assert {i.name for i in light.facing(facing(0.0))} == {"I000", "I001", "I002"}


@pytest.mark.parametrize(("count", "light"), [(5, "images"), (2, "sun")])
def test_images_are_the_source_if_half_of_the_maplets_lie_in_three(count, light):
    grids = [facing(lon) for lon in (0.0, 90.0, 180.0)]
    images = tuple(
        image_of(lon, sun, 10 * n + k)
        for n, lon in enumerate((0.0, 90.0))
        for k, sun in enumerate(suns(lon, count))
    )
    assert ImageSlopes.of(images, grids).light == light


def test_many_images_of_a_campaign_are_thinned_and_still_light_the_ground():
    images = tuple(image_of(0.0, sun, n) for n, sun in enumerate(suns(0.0, 200)))
    light = ImageSlopes(images, "sun")
    grid = facing(0.0)
    assert 40 <= len(list(light.facing(grid))) <= 48
    assert light.variance(Maplet("A", grid, np.zeros(grid.shape))).defined.all()


def test_pixels_are_read_for_images_only():
    asked = []

    def exposed(image):
        asked.append(image.name)
        return image

    images = tuple(image_of(0.0, sun, n) for n, sun in enumerate(suns(0.0, 4)))
    maplet = Maplet("A", facing(0.0), np.zeros((21, 21)))
    ImageSlopes(images, "sun", exposed).variance(maplet)
    assert not asked
    ImageSlopes(images, "images", exposed).variance(maplet)
    assert sorted(asked) == [image.name for image in images]


def test_steps_have_the_light_of_the_cells_on_both_sides():
    along_x = np.array([[1.0, 3.0, 2.0], [5.0, np.inf, np.inf]])
    light = SlopeVariance(along_x, 10.0 * along_x, np.full((2, 3), 5))
    # Three rows of four points: an edge on the border, or next to an undefined cell, has one cell.
    edges = np.array([[1.0, 3.0, 2.0], [3.0, 3.0, 2.0], [5.0, np.inf, np.inf]])
    np.testing.assert_array_equal(light_along_edges(light, 1, 1), edges)
    down = [[10.0, 20.0, 25.0, 20.0], [50.0, 50.0, np.inf, np.inf]]
    np.testing.assert_array_equal(light_along_edges(light, 1, 0), down)
    # Over a longer way the first and the last edge count.
    np.testing.assert_array_equal(light_along_edges(light, 3, 1)[:2, 0], [1.5, 2.5])
    # Half of the cells about a point, or more, have to be determined.
    points = [[True] * 4, [True] * 4, [True, True, False, False]]
    np.testing.assert_array_equal(light.at_points, points)


def test_the_error_of_brightness_is_found_from_steps():
    """Slopes with errors of 3 % of brightness where the light is good, and where it is poor."""
    grid = MapletGrid.facing([80.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 49)
    rng = np.random.default_rng(5)
    pairs = []
    for _ in range(8):
        variance = np.exp(ndimage.gaussian_filter(rng.normal(size=CELLS), 8.0) * 16.0)
        light = SlopeVariance(variance, variance, np.full(CELLS, 5))
        # Errors of rows that are independent random walks: each step has an error of its own sigma.
        step = 0.03 * grid.gsd * np.sqrt(light_along_edges(light, 1, 1))
        walk = np.cumsum(step * rng.normal(size=step.shape), axis=1)
        error = np.pad(walk, ((0, 0), (1, 0)))
        flat = np.zeros(grid.shape)
        pairs.append(AlignedHeights(flat, error, np.full(grid.shape, 1e-3), grid.gsd, light))
    # Along columns neighbouring walks have nothing in common: only rows are compared.
    found = estimate_information(pairs)
    assert found.usual_light == pytest.approx(1.0, rel=0.5)
    assert found.light_sigma > 0.03
    poor = found.step_sigma(np.zeros(2), np.zeros(2), grid.gsd, np.array([1.0, 100.0]))
    assert poor[1] > 3 * found.light_sigma * grid.gsd
    without = found.step_sigma(np.zeros(1), np.zeros(1), grid.gsd, np.array([np.inf]))
    assert without == pytest.approx(found.step_sigma_m)


def test_points_without_neighbours_do_not_affect_the_light_sigma(recwarn):
    grid = MapletGrid.facing([80.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 20)
    height = np.full(grid.shape, np.nan)
    height[::2, ::2] = np.random.default_rng(6).normal(size=(21, 21))
    ones, cells = np.ones(grid.shape), np.ones((40, 40))
    light = SlopeVariance(cells, cells, np.full(cells.shape, 5))
    found = estimate_information(
        [AlignedHeights(0.0 * height, height, 0.01 * ones, grid.gsd, light)]
    )
    assert (found.light_sigma, found.usual_light) == (0.0, 0.0)
    assert np.isfinite(found.step_sigma(ones, ones, grid.gsd, ones)).all()
    assert not recwarn.list
