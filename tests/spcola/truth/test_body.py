"""The synthetic body: a sphere by formula, hits on the surface, catalogues by their power laws."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import SettingsError
from spcola.grids import MapletGrid
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.body.relief import boulder_height, crater_height
from spcola.truth.body.roughness import add_noise
from spcola.truth.body.surface import low_degree, smoothed


@pytest.fixture(scope="module")
def body() -> TruthBody:
    return TruthBody(BodySettings(seed=7, radius=40.0))


def _directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_a_sphere_has_one_radius_and_one_albedo() -> None:
    sphere = TruthBody(BodySettings.sphere(75.0))
    np.testing.assert_allclose(sphere.radius(_directions(100)), 75.0, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(sphere.albedo(_directions(10)), np.ones(10))


def test_rays_meet_a_sphere_where_the_formula_says() -> None:
    sphere = TruthBody(BodySettings.sphere(75.0))
    out = _directions(400)
    origins = 3500.0 * out
    aim = 70.0 * _directions(400, seed=1)
    beam = aim - origins
    beam /= np.linalg.norm(beam, axis=1, keepdims=True)
    b = np.sum(origins * beam, axis=1)
    distance = -b - np.sqrt(b**2 - 3500.0**2 + 75.0**2)
    expected = origins + distance[:, None] * beam
    np.testing.assert_allclose(sphere.cast(origins, 5.0 * beam), expected, rtol=0, atol=1e-9)


def test_a_ray_past_or_away_from_the_body_misses() -> None:
    sphere = TruthBody(BodySettings.sphere(75.0))
    origins = np.array([[3500.0, 0.0, 0.0]] * 3)
    beams = np.array([[-1.0, 0.0, 0.03], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert np.isnan(sphere.cast(origins, beams)).all()


def test_heights_of_a_sphere_are_its_bulge() -> None:
    sphere = TruthBody(BodySettings.sphere(75.0))
    grid = MapletGrid.facing([60.0, 20.0, 30.0], [60.0, 20.0, 30.0], 1.0, 12)
    m, n = np.meshgrid(grid.offsets, grid.offsets, indexing="ij")
    expected = np.sqrt(75.0**2 - m**2 - n**2) - 70.0
    np.testing.assert_allclose(sphere.heights(grid), expected, rtol=0, atol=1e-9)


def test_heights_and_hits_lie_on_the_surface(body: TruthBody) -> None:
    center, normal = body.mean_plane(np.array([0.3, -0.8, 0.2]), 20.0)
    points = MapletGrid.facing(center, normal, 0.5, 20)
    points = points.points(body.heights(points)).reshape(-1, 3)
    error = np.linalg.norm(points, axis=1) - body.radius(points)
    assert np.max(np.abs(error)) < 1e-9


def test_nothing_lies_before_the_first_hit(body: TruthBody) -> None:
    origins = 300.0 * _directions(60, seed=3)
    aim = 25.0 * _directions(60, seed=4)
    hits = body.cast(origins, aim - origins)
    share = np.linspace(0.75, 0.9999, 4000)
    for origin, hit in zip(origins, hits, strict=True):
        along = origin + share[:, None] * (hit - origin)
        assert np.all(np.linalg.norm(along, axis=1) > body.radius(along) - 0.02)


def test_the_index_finds_every_crater_and_boulder(body: TruthBody) -> None:
    d = np.vstack([_directions(300, seed=5), body.settings.site.direction])
    surface = body._surface
    size = surface.radius
    boulders = surface.boulders.numbers
    for x, y, z in d:
        point = np.array([[x], [y], [z]]) * size
        swell, rough = np.zeros(1), np.zeros(1)
        add_noise(point, surface.swells, surface.seed, swell, 1)
        add_noise(point, surface.octaves, surface.seed, rough, 1)
        noise = swell[0] + smoothed(surface, x, y, z) * rough[0]
        ground = size * low_degree(surface.shape, x, y, z)
        ground += (1.0 + surface.roughness_contrast * (y * y - x * x)) * noise
        ground += sum(crater_height(x, y, z, size, crater) for crater in surface.craters.numbers)
        near = boulders[boulders[:, :3] @ [x, y, z] > 0]
        ground += max(boulder_height(x, y, z, size, boulder) for boulder in near)
        assert body.radius(np.array([[x, y, z]]))[0] == pytest.approx(ground, abs=1e-11)


def test_the_surface_stays_under_its_ceiling(body: TruthBody) -> None:
    assert body.radius(_directions(20_000)).max() < body._bounds.ceiling


def test_albedo_varies_as_stated() -> None:
    albedo = TruthBody(BodySettings(radius=75.0)).albedo(_directions(50_000))
    assert albedo.mean() == pytest.approx(1.0, abs=0.005)
    assert albedo.std() == pytest.approx(0.04, rel=0.08)


@pytest.mark.parametrize(
    "wrong",
    [
        {"seed": -1},
        {"radius": -1.0},
        {"roughness": -0.1},
        {"shortest": 200.0},
        {"roughness_contrast": 1.0},
        {"mean_albedo": 0.0},
        {"dark": 0.1},
        {"albedo": 0.5},
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SettingsError):
        BodySettings(**wrong)
