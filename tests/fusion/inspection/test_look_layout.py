"""How points are laid out flat, how surfaces are shaded, and what a shape looks like."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.inspection.look.ground import lay_out
from fusion.inspection.look.shading import length_unit, limits_of, shaded_colours
from fusion.inspection.look.shapes import smooth_normals
from spcola.math import lattice
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions


def test_a_site_keeps_distances_and_directions_even_at_a_pole() -> None:
    for middle in ([0.0, 0.0, 1.0], [0.3, -0.6, 0.5]):
        up = np.array(middle) / np.linalg.norm(middle)
        points = 1000.0 * lattice(40_000)
        points = points[points @ up > 1000.0 * np.cos(0.3)]
        view = lay_out(points)
        assert view.kind == "site"
        assert view.unit == "m"
        up = points.mean(axis=0) / np.linalg.norm(points.mean(axis=0))
        angle = np.arccos(np.clip(points @ up / 1000.0, -1.0, 1.0))
        np.testing.assert_allclose(np.hypot(view.x, view.y), 1000.0 * angle, atol=1e-6)
        assert np.abs(view.height).max() < 1e-6


def test_north_is_up_and_east_to_the_right_of_a_site() -> None:
    longitude, latitude = np.radians([50.0, 52.0, 50.0]), np.radians([10.0, 10.0, 12.0])
    points = 500.0 * np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    view = lay_out(points, frame="body-fixed")
    assert view.x[1] - view.x[0] > 10.0 * abs(view.y[1] - view.y[0])
    assert view.y[2] - view.y[0] > 10.0 * abs(view.x[2] - view.x[0])


def test_a_body_is_laid_out_by_longitude_and_a_local_cloud_as_it_is() -> None:
    assert lay_out(250.0 * lattice(500)).kind == "body"
    plane = np.random.default_rng(0).uniform(-1, 1, (400, 3)) * [100.0, 100.0, 1.0]
    assert lay_out(plane).kind == "map"
    assert lay_out(plane + np.array([636_000.0, 849_000.0, 400.0])).kind == "map"
    # The same plane above a body's north pole is a site of it.
    assert lay_out(plane + np.array([0.0, 0.0, 250.0])).kind == "site"
    # One track around a body, though it lies in a plane.
    turn = np.linspace(0.0, 2.0 * np.pi, 300)
    ring = 250.0 * np.stack([np.cos(turn), np.sin(turn), np.zeros(300)], axis=1)
    assert lay_out(ring).kind == "body"


def test_long_coordinates_of_a_projection_begin_at_the_corner() -> None:
    view = lay_out(np.array([[636_000.5, 20.0, 1.0], [636_040.0, 60.0, 2.0]]), frame="projected")
    np.testing.assert_allclose(view.x, [0.5, 40.0])
    np.testing.assert_allclose(view.y, [20.0, 60.0])
    assert "636000" in view.labels[0]


def test_level_ground_keeps_its_colour_and_gaps_have_their_own() -> None:
    from matplotlib import colormaps  # noqa: PLC0415

    values = np.array([[0.0, 1.0, np.nan, 0.5]])
    shade = np.array([[np.sqrt(0.5), np.sqrt(0.5), 0.5, np.nan]])
    image = shaded_colours(values, shade, "viridis", (0.0, 1.0))
    np.testing.assert_allclose(image[0, :2], colormaps["viridis"]([0.0, 1.0]), atol=1e-12)
    np.testing.assert_array_equal(image[0, 2], image[0, 3])
    darker = shaded_colours(values, 0.3 * shade, "viridis", (0.0, 1.0))
    assert (darker[0, 1, :3] < image[0, 1, :3]).all()


def test_isolated_points_do_not_take_the_colours() -> None:
    values = np.append(np.linspace(0.0, 1.0, 1000), 1e6)
    assert limits_of(values)[1] < 1.1
    assert limits_of(np.full(3, np.nan)) == (0.0, 1.0)
    assert limits_of(np.full(3, 7.0)) == (6.5, 7.5)
    assert (length_unit(500.0), length_unit(1.7e6)) == ((1.0, "m"), (1e3, "km"))


def test_normals_of_a_coarse_sphere_are_smooth() -> None:
    mesh = IcqShape(icq_directions(6)).mesh()
    ways = lattice(400)
    hits = RayCaster(mesh).cast(3.0 * ways, -ways)
    smooth = smooth_normals(mesh, hits)
    flat = np.degrees(np.arccos(np.clip(np.sum(hits.normals * ways, axis=1), -1, 1)))
    found = np.degrees(np.arccos(np.clip(np.sum(smooth * ways, axis=1), -1, 1)))
    assert found.max() < 2.5
    assert found.mean() < 0.35 * flat.mean()
    missed = RayCaster(mesh).cast(3.0 * ways[:2], ways[:2])
    assert np.isnan(smooth_normals(mesh, missed)).all()


def test_units_are_told() -> None:
    assert lay_out(1.737e6 * lattice(300)).labels[3] == "radius, km"
    assert pytest.approx(1737.0) == lay_out(1.737e6 * lattice(300)).height[0]
