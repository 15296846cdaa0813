from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera, SpcImage, project_image
from spcola.control import (
    Landmark,
    scaled,
)
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import NominalState
from spcola.shape import Mesh

FACTOR = 1.00025
GRID = MapletGrid.facing([240.0, 30.0, -20.0], [8.0, 1.0, -1.0], 0.35, 4)
IMAGE = SpcImage(
    "I1",
    "2019 MAR 07 12:00:00",
    Camera(125.0, [512.5, 512.5], [[117.0, 0, 0], [0, 117.0, 0]], 1024, 1024),
    [-1500.0, -200.0, 100.0],
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
    [1.0, 0.0, 0.0],
    scobj_sigma=[0.2, 0.2, 0.2],
)


def test_points_of_a_scaled_maplet_fall_where_they_fell_in_a_scaled_image():
    height = np.random.default_rng(1).normal(size=GRID.shape)
    maplet = Maplet("A", GRID, height, sigma=np.full(GRID.shape, 0.1))
    larger = scaled(maplet, FACTOR)
    points, moved = GRID.points(maplet.height), larger.grid.points(larger.height)
    np.testing.assert_allclose(moved, FACTOR * points, rtol=1e-14)
    before = project_image(IMAGE, points.reshape(-1, 3))
    after = project_image(scaled(IMAGE, FACTOR), moved.reshape(-1, 3))
    np.testing.assert_allclose(np.array(after), np.array(before), atol=1e-8)
    np.testing.assert_allclose(larger.sigma, 0.1 * FACTOR)


def test_every_length_is_scaled_and_nothing_else():
    image = scaled(IMAGE, FACTOR)
    np.testing.assert_allclose(image.position, FACTOR * IMAGE.position)
    np.testing.assert_allclose(image.scobj_sigma, 0.2 * FACTOR)
    np.testing.assert_array_equal(image.axes, IMAGE.axes)
    landmark = scaled(Landmark("A", GRID, [0.1, 0.2, 0.3], 0.5), FACTOR)
    assert landmark.grid.gsd == FACTOR * GRID.gsd
    assert landmark.prior_sigma == pytest.approx(0.5 * FACTOR)
    np.testing.assert_allclose(landmark.sigma, FACTOR * np.array([0.1, 0.2, 0.3]))
    nominal = scaled(
        NominalState("I1", [1.0, 2.0, 3.0], IMAGE.scobj, IMAGE.axes, [6.0, 6.0, 6.0]), FACTOR
    )
    np.testing.assert_allclose(nominal.scobj, image.scobj)
    np.testing.assert_allclose(nominal.velocity, FACTOR * np.array([1.0, 2.0, 3.0]))
    mesh = Mesh(np.eye(3), [[0, 1, 2]])
    np.testing.assert_allclose(scaled(mesh, FACTOR).vertices, FACTOR * np.eye(3))
