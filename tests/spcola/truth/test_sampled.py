"""The sampled surface: rays against formulas and a slow reference, tiles under short memory."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from spcola.errors import InvalidValueError, SettingsError
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.body.surface_points import SurfacePoints
from spcola.truth.sampled import SampledSurface
from spcola.truth.sampled.cube import Tiling, fill_tile, place_of

RADIUS = 50.0


class Sphere:
    def radius(self, directions: np.ndarray) -> np.ndarray:
        return np.full(len(directions), RADIUS)


class Bumpy:
    """Hills and valleys of some metres, with slopes up to about 45°."""

    def radius(self, directions: np.ndarray) -> np.ndarray:
        x, y, z = directions.T
        waves = np.sin(9.0 * x + 1.0) * np.cos(8.0 * y) + np.sin(11.0 * z - 5.0 * x) * x
        return RADIUS * (1.0 + 0.06 * waves)


class Mesa:
    """A sphere with a table mountain at the north pole."""

    height, half_width = 4.0, 0.15

    def radius(self, directions: np.ndarray) -> np.ndarray:
        on_top = directions[:, 2] > np.cos(self.half_width)
        return np.where(on_top, RADIUS + self.height, RADIUS)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rays_around(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rays from 1.1 to 8 radii toward points in the body's cube, and some exactly along axes."""
    rng = np.random.default_rng(seed)
    origins = RADIUS * rng.uniform(1.3, 8.0, size=(count, 1)) * unit(rng.normal(size=(count, 3)))
    beams = unit(RADIUS * rng.uniform(-1.0, 1.0, size=(count, 3)) - origins)
    corners = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    corners = corners[np.any(corners != 0, axis=1)]
    # Straight down on faces, edges and corners of the cube, and past them along axes.
    special = [(3.0 * RADIUS * unit(corners), -unit(corners))]
    for axis in np.eye(3):
        special.append((RADIUS * (0.7 * unit(corners) - 3.0 * axis), np.tile(axis, (26, 1))))
    return (
        np.concatenate([origins, *(pair[0] for pair in special)]),
        np.concatenate([beams, *(pair[1] for pair in special)]),
    )


def bilinear(body: Bumpy, cells: int, directions: np.ndarray) -> np.ndarray:
    """The radius between nodes of the cube's faces, `cells` to a side, as it is defined."""
    size = np.abs(directions)
    axis = np.argmax(size, axis=1)
    rows = np.arange(len(directions))
    w = directions[rows, axis]
    others = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    u = directions[rows, others[:, 0]] / np.abs(w)
    v = directions[rows, others[:, 1]] / np.abs(w)
    i = np.minimum(((u + 1) / 2 * cells).astype(int), cells - 1)
    j = np.minimum(((v + 1) / 2 * cells).astype(int), cells - 1)
    p, q = (u + 1) / 2 * cells - i, (v + 1) / 2 * cells - j
    value = np.zeros(len(directions))
    for di in (0, 1):
        for dj in (0, 1):
            node = np.empty_like(directions)
            node[rows, axis] = np.sign(w)
            node[rows, others[:, 0]] = 2 * (i + di) / cells - 1
            node[rows, others[:, 1]] = 2 * (j + dj) / cells - 1
            weight = (p if di else 1 - p) * (q if dj else 1 - q)
            value += weight * body.radius(unit(node))
    return value


def slow_hits(surface: SampledSurface, origins: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Distance of first hits by small steps and bisection, NaN for a miss."""
    closest = -np.sum(origins * beams, axis=1)
    steps = np.arange(-75.0, 75.0, 0.05)
    t = np.maximum(closest, 0.0)[:, None] + steps
    t = np.maximum(t, 0.0)

    def height(t: np.ndarray) -> np.ndarray:
        points = origins[:, None] + t[..., None] * beams[:, None]
        flat = points.reshape(-1, 3)
        return (np.linalg.norm(flat, axis=1) - surface.radius(flat)).reshape(t.shape)

    below = height(t) < 0
    first = np.argmax(below, axis=1)
    low = t[np.arange(len(t)), np.maximum(first - 1, 0)][:, None]
    high = t[np.arange(len(t)), first][:, None]
    for _ in range(60):
        middle = 0.5 * (low + high)
        under = height(middle) < 0
        low, high = np.where(under, low, middle), np.where(under, middle, high)
    hit = below.any(axis=1) & ~below[:, 0]
    return np.where(hit, high[:, 0], np.nan)


def test_rays_on_a_sphere_by_formula() -> None:
    origins, beams = rays_around(20_000)
    hits = SampledSurface(Sphere(), 1.0).cast(origins, 3.0 * beams)
    closest = -np.sum(origins * beams, axis=1)
    half = RADIUS**2 - np.sum((origins + closest[:, None] * beams) ** 2, axis=1)
    outside = np.linalg.norm(origins, axis=1) > RADIUS
    expected = np.where((half > 0) & (closest > 0), closest - np.sqrt(np.maximum(half, 0)), np.nan)
    expected[~outside] = np.nan
    np.testing.assert_array_equal(hits.hit, np.isfinite(expected))
    # A grazing ray that is within 1e-9 m of the ground may be 1e-7 m from the point.
    np.testing.assert_allclose(hits.distance, expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.nanmedian(np.abs(hits.distance - expected)), 0, atol=1e-12)
    found = hits.points[hits.hit]
    np.testing.assert_allclose(hits.normals[hits.hit], unit(found), atol=1e-12)
    assert np.isnan(hits.points[~hits.hit]).all()
    assert np.isnan(hits.normals[~hits.hit]).all()


def test_the_radius_is_bilinear_on_the_faces() -> None:
    surface, rng = SampledSurface(Bumpy(), 1.5), np.random.default_rng(1)
    directions = unit(np.concatenate([rng.normal(size=(5000, 3)), rays_around(1)[0]]))
    tiling = surface.tiling
    expected = bilinear(Bumpy(), tiling.across * tiling.size, directions)
    np.testing.assert_allclose(surface.radius(7.0 * directions), expected, rtol=0, atol=2e-6)


def test_rays_on_hills_as_by_small_steps() -> None:
    surface = SampledSurface(Bumpy(), 1.5)
    origins, beams = rays_around(400)
    hits = surface.cast(origins, beams)
    expected = slow_hits(surface, origins, beams)
    both = hits.hit & np.isfinite(expected)
    assert both.sum() > 250
    # The reference steps over what is grazed for less than 5 cm; nothing else may differ.
    differs = np.flatnonzero(hits.hit != np.isfinite(expected))
    assert len(differs) <= 2
    apart = np.abs(hits.distance - expected)[both]
    assert np.quantile(apart, 0.99) < 1e-7
    heights = np.linalg.norm(hits.points, axis=1)[hits.hit]
    np.testing.assert_allclose(heights, surface.radius(hits.points[hits.hit]), atol=2e-9)


def test_a_ray_from_between_the_hills_or_from_below() -> None:
    surface = SampledSurface(Bumpy(), 1.5)
    rng = np.random.default_rng(2)
    up = unit(rng.normal(size=(300, 3)))
    beams = unit(rng.normal(size=(300, 3)))
    above = (surface.radius(up) + 0.3)[:, None] * up
    hits = surface.cast(above, beams)
    expected = slow_hits(surface, above, beams)
    assert np.count_nonzero(hits.hit != np.isfinite(expected)) <= 2
    both = hits.hit & np.isfinite(expected)
    assert np.quantile(np.abs(hits.distance - expected)[both], 0.98) < 1e-7
    below = (surface.radius(up) - 0.3)[:, None] * up
    assert not surface.cast(below, beams).hit.any()


def test_normals_are_those_of_the_body() -> None:
    """Against a numerical gradient of the body itself; the sampling's error goes as spacing²."""
    up = unit(np.random.default_rng(4).normal(size=(2000, 3)))
    errors = []
    for spacing in (0.8, 0.4):
        surface = SampledSurface(Bumpy(), spacing)
        hits = surface.cast(2.0 * RADIUS * up, -up)
        step = 1e-4
        gradient = np.empty_like(up)
        for axis in np.eye(3):
            ahead, behind = unit(hits.points + step * axis), unit(hits.points - step * axis)
            slope = (Bumpy().radius(ahead) - Bumpy().radius(behind)) / (2 * step)
            gradient[:, np.argmax(axis)] = slope
        exact = unit(up - gradient)
        errors.append(np.arccos(np.clip(np.sum(exact * hits.normals, axis=1), -1, 1)).max())
    assert errors[1] < 0.3 * errors[0] < 0.01


def test_the_difference_from_the_body_goes_with_the_square_of_the_spacing() -> None:
    up = unit(np.random.default_rng(5).normal(size=(5000, 3)))
    exact = Bumpy().radius(up)
    errors = [np.abs(SampledSurface(Bumpy(), s).radius(up) - exact).max() for s in (0.8, 0.4)]
    assert errors[1] == pytest.approx(errors[0] / 4.0, rel=0.1)


def test_the_truth_body_is_met_within_millimetres() -> None:
    body = TruthBody(BodySettings(seed=3, radius=60.0))
    surface = SampledSurface(body, 0.1)
    rng = np.random.default_rng(6)
    # A patch of 5 m: few tiles.
    up = unit(np.array([0.6, -0.7, 0.5]) + 0.04 * rng.uniform(-1, 1, size=(3000, 3)))
    error = surface.radius(up) - body.radius(up)
    assert np.sqrt(np.mean(error**2)) < 3e-3
    assert np.quantile(np.abs(error), 0.99) < 1.2e-2


def test_shadow_on_a_sphere_begins_at_the_terminator() -> None:
    surface = SampledSurface(Sphere(), 0.5)
    points = RADIUS * unit(np.random.default_rng(7).normal(size=(20_000, 3)))
    sun = unit(np.array([1.0, -2.0, 0.5]))
    cosine = unit(points) @ sun
    dark = surface.occluded(points, 5.0 * sun)
    # From 1 % of the spacing above the ground the horizon lies this much lower.
    dip = np.sqrt(2.0 * 0.01 * 0.5 / RADIUS) + 1e-3
    assert dark[cosine < -dip].all()
    assert not dark[cosine > 1e-6].any()


def test_shadow_of_a_table_mountain_ends_where_geometry_says() -> None:
    surface = SampledSurface(Mesa(), 0.1)
    elevation = np.radians(40.0)  # of the Sun above the pole's horizon, in the plane of x and z
    sun = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    angle = np.linspace(-0.6, -Mesa.half_width - 0.01, 2000)
    points = RADIUS * np.stack([np.sin(angle), np.zeros(2000), np.cos(angle)], axis=1)
    dark = surface.occluded(points, sun)
    edge = (RADIUS + Mesa.height) * np.array([-np.sin(Mesa.half_width), np.cos(Mesa.half_width)])
    rise = np.arctan2(edge[1] - points[:, 2], edge[0] - points[:, 0])
    expected = rise > elevation
    ends = [points[np.flatnonzero(which)[0], 0] for which in (dark, expected)]
    # The edge of the mountain falls over one cell; the ray meets it at 40°.
    assert abs(ends[0] - ends[1]) < 0.1
    assert not dark[: np.argmax(expected) - 40].any()


def test_points_below_the_sampled_ground_are_lifted_and_unknown_ones_stay_lit() -> None:
    surface = SampledSurface(Sphere(), 1.0)
    up = np.array([0.0, 0.0, 1.0])
    points = np.array([[0.0, 0.0, RADIUS - 0.4], [0.0, 0.0, RADIUS + 0.4], [np.nan, 0.0, 1.0]])
    assert not surface.occluded(points, up).any()
    each = np.array([-up, -up, up])
    np.testing.assert_array_equal(surface.occluded(points, each), [True, True, False])


def test_short_memory_changes_nothing() -> None:
    origins, beams = rays_around(3000)
    plenty = SampledSurface(Bumpy(), 1.0)
    tile_bytes = 4 * plenty.tiling.length
    scarce = SampledSurface(Bumpy(), 1.0, memory_bytes=40 * tile_bytes)
    expected, found = plenty.cast(origins, beams), scarce.cast(origins, beams)
    np.testing.assert_array_equal(found.distance, expected.distance)
    np.testing.assert_array_equal(found.normals, expected.normals)
    up = unit(origins)
    np.testing.assert_array_equal(scarce.radius(up), plenty.radius(up))
    assert scarce.tiles_made > plenty.tiles_made
    assert scarce.memory_bytes <= 40 * tile_bytes


def test_many_threads_and_short_memory() -> None:
    rays = [rays_around(300, seed) for seed in range(12)]
    plenty = SampledSurface(Bumpy(), 1.0)
    scarce = SampledSurface(Bumpy(), 1.0, memory_bytes=60 * 4 * plenty.tiling.length)
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda pair: scarce.cast(*pair).distance, rays))
        dark = list(pool.map(lambda pair: scarce.occluded(*pair), rays))
    for pair, distance, covered in zip(rays, found, dark, strict=True):
        np.testing.assert_array_equal(distance, plenty.cast(*pair).distance)
        np.testing.assert_array_equal(covered, plenty.occluded(*pair))


def test_a_tile_that_failed_is_made_again() -> None:
    class Moody(Sphere):
        fails = False

        def radius(self, directions: np.ndarray) -> np.ndarray:
            if self.fails:
                raise OSError("no")
            return super().radius(directions)

    body = Moody()
    surface = SampledSurface(body, 1.0)
    origins, beams = rays_around(50)
    body.fails = True
    for _ in range(2):
        with pytest.raises(OSError, match="no"):
            surface.cast(origins, beams)
    body.fails = False
    expected = SampledSurface(Sphere(), 1.0).cast(origins, beams)
    np.testing.assert_array_equal(surface.cast(origins, beams).distance, expected.distance)


def test_settings_that_cannot_work_are_refused() -> None:
    for spacing in (0.0, -1.0, np.nan):
        with pytest.raises(SettingsError, match="spacing"):
            SampledSurface(Sphere(), spacing)
    with pytest.raises(SettingsError, match="memory"):
        SampledSurface(Sphere(), 1.0, memory_bytes=100)
    with pytest.raises(InvalidValueError, match="normals"):
        SurfacePoints(np.zeros(3), np.zeros((3, 3)), np.zeros((2, 3)))


def test_the_maxima_of_a_tile() -> None:
    tiling = Tiling.of(3, 16, 10.0)
    values = np.random.default_rng(8).normal(size=tiling.nodes)
    tile = np.empty(tiling.length, dtype=np.float32)
    low, high = fill_tile(tiling, values, tile)
    inner = tile[: tiling.nodes].reshape(19, 19)[1:-1, 1:-1]
    assert (low, high) == (10.0 + inner.min(), 10.0 + inner.max())
    for level in range(1, 5):
        block = 2**level
        windows = np.lib.stride_tricks.sliding_window_view(inner, (block + 1, block + 1))
        expected = windows[::block, ::block].max(axis=(2, 3)).ravel()
        start = tiling.starts[level]
        np.testing.assert_array_equal(tile[start : start + len(expected)], expected)


def test_faces_meet_at_their_edges() -> None:
    tiling = Tiling.of(4, 16, 0.0)
    assert place_of(tiling, 2.0, 1.0, -1.0) == (0, 48.0, 16.0)
    assert place_of(tiling, 1.0, -2.0, 0.0) == (3, 48.0, 32.0)
    assert place_of(tiling, 0.5, 0.0, -1.0) == (5, 48.0, 32.0)
