"""Normals, nearest points, terrain and global shapes of the synthetic body."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.grids import MapletGrid
from spcola.truth.body import BOULDER, CRATER, SMOOTH, BodySettings, TruthBody
from spcola.truth.body.relief import PowerLaw
from spcola.truth.body.surface_points import SurfacePoints


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


@pytest.fixture(scope="module")
def sphere() -> TruthBody:
    return TruthBody(BodySettings.sphere(75.0))


def _directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)


def test_normals_of_a_sphere_point_outward(sphere: TruthBody) -> None:
    d = np.vstack([_directions(200), np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(sphere.normals(7.0 * d), d, rtol=0, atol=1e-8)


def test_normals_are_those_of_the_low_degree_shape_by_formula() -> None:
    none = PowerLaw(0.0, 2.7, 1.0, 2.0)
    smooth = TruthBody(BodySettings(roughness=0.0, craters=none, boulders=none))
    c = smooth._surface.shape
    latitude = np.radians(np.linspace(-85.0, 85.0, 35))
    # Only the zonal part, by its derivative; the rest is taken out.
    smooth.__dict__["_surface"] = smooth._surface._replace(
        shape=np.concatenate([c[:3], np.zeros(8)])
    )
    z, cosine = np.sin(latitude), np.cos(latitude)
    r = 1.0 + c[0] * (3 * z**2 - 1) / 2 + c[1] * (5 * z**3 - 3 * z) / 2
    r += c[2] * (35 * z**4 - 30 * z**2 + 3) / 8
    slope = c[0] * 3 * z + c[1] * (15 * z**2 - 3) / 2 + c[2] * (140 * z**3 - 60 * z) / 8
    up, north = np.stack([cosine, 0 * z, z], axis=1), np.stack([-z, 0 * z, cosine], axis=1)
    expected = up - (slope * cosine / r)[:, None] * north
    expected /= _lengths(expected)[:, None]
    np.testing.assert_allclose(smooth.normals(up), expected, rtol=0, atol=1e-8)


def test_normals_agree_with_planes_through_the_surface(body: TruthBody) -> None:
    d = _directions(300, seed=8)
    normals = body.normals(d)
    np.testing.assert_allclose(_lengths(normals), 1.0, rtol=0, atol=1e-14)
    assert np.sum(normals * d, axis=1).min() > 0.3
    step = 1e-4 * np.random.default_rng(9).normal(size=(300, 3))
    near = d + step / 40.0
    here, there = body.radius(d)[:, None] * d, body.radius(near)[:, None] * near
    there /= _lengths(near)[:, None]
    off = np.sum((there - here) * normals, axis=1) / _lengths(there - here)
    # A step that crosses the edge of a boulder shows its slope.
    assert np.median(np.abs(off)) < 1e-4
    assert np.percentile(np.abs(off), 97.0) < 2e-3


def test_first_hits_are_complete(body: TruthBody) -> None:
    d = _directions(100)
    hits = body.first_hits(300.0 * d, np.vstack([-d[:90], d[90:]]))
    assert isinstance(hits, SurfacePoints)
    assert np.isfinite(hits.distance[:90]).all()
    assert np.isnan(hits.distance[90:]).all()
    assert np.isnan(hits.normals[90:]).all()
    np.testing.assert_allclose(_lengths(300.0 * d - hits.points)[:90], hits.distance[:90], 1e-13)
    np.testing.assert_array_equal(hits.normals[:90], body.normals(hits.points[:90]))


def test_a_ray_from_low_above_the_ground_hits_and_one_from_below_does_not(body: TruthBody) -> None:
    d = _directions(200, seed=2)
    ground = body.radius(d)[:, None] * d
    hits = body.first_hits(ground + 0.05 * d, -d)
    np.testing.assert_allclose(hits.distance, 0.05, rtol=0, atol=1e-9)
    assert np.isnan(body.first_hits(ground - 0.05 * d, -d).distance).all()


def test_grazing_rays_hit_what_they_first_come_to(body: TruthBody) -> None:
    rng = np.random.default_rng(6)
    d = _directions(150, seed=5)
    across = np.cross(d, _directions(150, seed=6))
    across /= _lengths(across)[:, None]
    target = (body.radius(d) + rng.uniform(-1.0, 1.5, 150))[:, None] * d
    origins = target - 90.0 * across
    found = body.first_hits(origins, across).distance
    steps = np.linspace(0.0, 180.0, 18_001)
    for origin, beam, distance in zip(origins, across, found, strict=True):
        places = origin + steps[:, None] * beam
        below = _lengths(places) < body.radius(places)
        if np.isnan(distance):
            depth = (body.radius(places) - _lengths(places)).max()
            assert depth < 0.02
        else:
            before = steps < distance - 1e-6
            depth = (body.radius(places) - _lengths(places))[before].max()
            assert depth < 0.02
            assert below[np.searchsorted(steps, distance) :].any() or distance < 180.0


def test_nearest_points_of_a_sphere(sphere: TruthBody) -> None:
    d = _directions(300)
    size = np.random.default_rng(1).uniform(70.0, 80.0, 300)
    nearest = sphere.nearest(size[:, None] * d)
    np.testing.assert_allclose(nearest.points, 75.0 * d, rtol=0, atol=2e-6)
    np.testing.assert_allclose(nearest.distance, size - 75.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nearest.normals, d, rtol=0, atol=1e-7)


def test_points_moved_along_the_normal_come_back(body: TruthBody) -> None:
    d = _directions(600, seed=3)
    ground = body.radius(d)[:, None] * d
    for height in (0.1, -0.1, 0.0):
        nearest = body.nearest(ground + height * body.normals(d))
        # What the lattice of the search misses is a small part of its distance.
        assert np.abs(nearest.distance).max() < 1.015 * abs(height) + 1e-9
        assert np.all(nearest.distance * height >= 0.0)
        # Where no other part of the surface is as near, that is the very point.
        back = _lengths(nearest.points - ground) < 1e-4
        assert back.mean() > (0.9 if height else 0.999)
        np.testing.assert_allclose(nearest.distance[back], height, rtol=0, atol=1e-8)


def test_nothing_is_nearer_than_the_nearest_point(body: TruthBody) -> None:
    rng = np.random.default_rng(4)
    d = _directions(150, seed=4)
    points = body.radius(d)[:, None] * d + rng.normal(scale=0.25, size=(150, 3))
    nearest = body.nearest(points)
    np.testing.assert_allclose(
        _lengths(nearest.points - points), np.abs(nearest.distance), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        _lengths(nearest.points), body.radius(nearest.points), rtol=0, atol=1e-11
    )
    for point, distance in zip(points, np.abs(nearest.distance), strict=True):
        near = point + 1.2 * distance * rng.uniform(-1.0, 1.0, size=(20_000, 3))
        surface = near * (body.radius(near) / _lengths(near))[:, None]
        # The lattice of the search is a third of the distance wide: what it misses is smaller.
        assert _lengths(surface - point).min() > 0.97 * distance - 1e-3


def test_the_terrain_is_that_of_the_catalogues() -> None:
    body = TruthBody()
    size = body.settings.radius
    boulders, craters, site = body.boulders, body.craters, body.settings.site
    assert site is not None
    smallest = 1.0
    large = boulders.diameter >= smallest
    assert np.all(body.terrain(boulders.direction[large], smallest=smallest) & BOULDER)
    wide = craters.diameter >= 2.0 * smallest
    assert np.all(body.terrain(craters.direction[wide], smallest=smallest) & CRATER)
    across = np.cross(site.direction, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    places = site.direction + np.array([[0.0], [24.9], [25.3]]) / size * across
    assert list(body.terrain(places, smallest=smallest) & SMOOTH > 0) == [True, True, False]
    d = _directions(40_000)
    flags = body.terrain(d, smallest=smallest)
    assert flags.dtype == np.uint8
    small = np.flatnonzero(boulders.diameter < smallest)
    axes = boulders.numbers[:, 3:6] / _lengths(boulders.numbers[:, 3:6])[:, None]
    for n in (0, 10, int(small[0])):
        edge = boulders.direction[n] + 0.499 * boulders.diameter[n] / size * axes[n]
        off_side = boulders.direction[n] + 0.501 * boulders.diameter[n] / size * axes[n]
        inside = body.terrain(np.stack([edge, off_side]), smallest=boulders.diameter[n])
        outside = body.terrain(np.stack([edge, off_side]), smallest=1.001 * boulders.diameter[n])
        assert inside[0] & BOULDER
        assert not (inside[1] & BOULDER) or n > 0
        assert not (outside[0] & BOULDER) or n > 0
    # Shares of the area: of ellipses of mean axes ratio 0.8, and of circles.
    share = np.sum(np.pi / 4.0 * 0.8 * boulders.diameter[large] ** 2) / (4.0 * np.pi * size**2)
    assert np.mean(flags & BOULDER > 0) == pytest.approx(share, rel=0.15)
    share = np.sum(np.pi / 4.0 * craters.diameter[wide] ** 2) / (4.0 * np.pi * size**2)
    assert np.mean(flags & CRATER > 0) == pytest.approx(share, rel=0.15)


def test_global_shapes_lie_on_the_surface(body: TruthBody) -> None:
    shape = body.icq(16)
    vertices = shape.vertices.reshape(-1, 3)
    np.testing.assert_allclose(_lengths(vertices), body.radius(vertices), rtol=0, atol=1e-11)
    mesh = body.mesh(16)
    assert len(mesh.vertices) == 6 * 16**2 + 2
    assert mesh.mean_radius == pytest.approx(40.0, rel=0.05)


def test_a_place_has_one_height_at_any_resolution(body: TruthBody) -> None:
    center, normal = body.mean_plane(np.array([0.3, -0.8, 0.2]), 20.0)
    coarse = body.heights(MapletGrid.facing(center, normal, 0.4, 10))
    fine = body.heights(MapletGrid.facing(center, normal, 0.1, 40))
    np.testing.assert_allclose(fine[::4, ::4], coarse, rtol=0, atol=1e-10)
    d = _directions(3000)
    alone = np.array([body.radius(d[n : n + 1])[0] for n in range(0, 3000, 100)])
    np.testing.assert_array_equal(body.radius(d)[::100], alone)
    np.testing.assert_array_equal(body.radius(np.tile(d, (20, 1)))[-3000:], body.radius(d))
