"""Tiling: all ground covered, overlap as asked, heights those of what is below."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ellipsoids import ellipsoid, random_points
from scipy.ndimage import map_coordinates

from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.shape import Mesh, RayCaster, shape_heights
from spcola.shape.tiling import Circle, Ground, mesh_of_maplets, seeded

BODY = ellipsoid(60.0, 50.0, 40.0)
CASTER = RayCaster(BODY)
UP = np.array([0.6, 0.0, 0.8])


def on_body(gsd: float, half_size: int, up: np.ndarray = UP) -> MapletGrid:
    point = CASTER.cast(200.0 * up[None], -up[None]).points[0]
    return MapletGrid.facing(point, up, gsd, half_size)


def of_shape(name: str, grid: MapletGrid, **layers: np.ndarray) -> Maplet:
    return Maplet(name, grid, shape_heights(CASTER, grid, reach=grid.radius), **layers)


def inside(maplets: list[Maplet], points: np.ndarray) -> np.ndarray:
    """Which points (N, 3) lie within a thousandth of a side of a maplet's surface."""
    found = np.zeros(len(points), bool)
    for maplet in maplets:
        x, y, height = maplet.grid.project(points)
        places = np.stack([y, x]) + maplet.grid.half_size
        own = map_coordinates(maplet.height, places, order=1, cval=np.nan)
        found |= np.abs(own - height) < 0.2
    return found


def test_every_point_of_a_body_is_covered() -> None:
    ground = Ground(BODY, 0.7, 12, overlap=0.33)
    seeds = [seeded("X", grid, [], CASTER) for grid in ground.grids()]
    for seed in seeds:
        ground.cover(seed.maplet)
    assert ground.share == 1.0
    assert ground.further_grids() == []
    points, _ = random_points(BODY, 4000)
    assert inside([seed.maplet for seed in seeds], points).all()


@pytest.mark.parametrize("overlap", [0.35, 0.6])
def test_neighbours_overlap_as_asked(overlap: float) -> None:
    ground = Ground(BODY, 0.5, 12, overlap=overlap)
    area = np.linalg.norm(BODY.area_vectors, axis=1).sum()
    spacing = np.sqrt(area / len(ground.grids()))
    assert 1.0 - spacing / 12.0 == pytest.approx(overlap, abs=0.03)


def test_only_a_region_is_tiled_and_all_of_it() -> None:
    circle = Circle(UP, 15.0)
    ground = Ground(BODY, 0.25, 12, overlap=0.33, circle=circle)
    grids = ground.grids()
    assert all(circle.holds(grid.center) for grid in grids)
    maplets = [seeded("X", grid, [], CASTER).maplet for grid in grids]
    assert all(ground.cover(maplet) for maplet in maplets)
    assert ground.share == 1.0
    points, _ = random_points(BODY, 4000)
    covered = inside(maplets, points)
    held = circle.holds(points)
    assert 20 < held.sum() < 1000
    assert covered[held].all()
    assert not covered[~Circle(UP, 15.0 + 6.0).holds(points)].any()


def test_a_region_smaller_than_a_maplet_gets_one() -> None:
    (only,) = Ground(BODY, 0.5, 12, overlap=0.33, circle=Circle(UP, 2.0)).grids()
    assert np.linalg.norm(only.center - on_body(0.5, 12).center) < 0.5
    far = Mesh(BODY.vertices + np.array([1000.0, 0.0, 0.0]), BODY.facets)
    with pytest.raises(InvalidValueError, match="circle"):
        Ground(far, 0.5, 12, overlap=0.33, circle=Circle(-UP, 2.0))


def test_a_second_pass_covers_what_the_first_left() -> None:
    ground = Ground(BODY, 0.7, 12, overlap=0.33)
    for grid in ground.grids():
        whole = seeded("X", grid, [], CASTER).maplet
        height = whole.height.copy()
        height[whole.points()[..., 0] > 40.0] = np.nan  # as if nothing were known there
        ground.cover(whole.with_layers(height=height))
    assert 0.5 < ground.share < 0.95
    further = ground.further_grids()
    assert further
    assert all(grid.center[0] > 38.0 for grid in further)
    gained = [ground.cover(seeded("X", grid, [], CASTER).maplet, 0.01) for grid in further]
    assert gained[0]
    # A maplet that would add less than a hundredth of its square is not worth it.
    assert ground.share > 0.9999


def test_a_seed_lies_on_the_shape_and_its_centre_too() -> None:
    grid = on_body(0.5, 20)
    lifted = replace(grid, center=grid.center + 0.3 * grid.uz)
    maplet = seeded("X", lifted, [], CASTER).maplet
    assert maplet.valid.all()
    assert CASTER.closest(maplet.points().reshape(-1, 3)).distance.max() < 1e-6
    np.testing.assert_allclose(maplet.grid.center, grid.center, atol=1e-6)
    assert maplet.height[20, 20] == 0.0


def test_a_coarser_maplet_is_reproduced_by_projection() -> None:
    rng = np.random.default_rng(2)
    coarse_grid = on_body(1.0, 20)
    coarse = Maplet(
        "C", coarse_grid, 0.3 * rng.normal(size=coarse_grid.shape),
        albedo=rng.uniform(0.8, 1.2, coarse_grid.shape), center_sigma=[0.1, 0.2, 0.3],
    )  # fmt: skip
    fine = replace(coarse_grid, gsd=0.25, half_size=30)
    seed = seeded("F", fine, [coarse], None)
    steps = 0.25 * fine.offsets + 20.0
    places = np.meshgrid(steps, steps, indexing="ij")
    x, y, height = fine.project(seed.maplet.points())
    np.testing.assert_allclose(height, map_coordinates(coarse.height, places, order=1), atol=1e-9)
    np.testing.assert_allclose(
        seed.maplet.albedo, map_coordinates(coarse.albedo, places, order=1), atol=1e-9
    )
    assert (seed.sources, seed.from_maplets, seed.from_shape) == (("C",), 1.0, 0.0)
    np.testing.assert_allclose(seed.maplet.center_sigma, [0.1, 0.2, 0.3])
    assert x.shape == y.shape


def test_the_finest_maplets_come_first_and_unknown_stays_unknown() -> None:
    coarse = Maplet("C", on_body(2.0, 6), np.full((13, 13), 5.0))
    finer = Maplet("D", on_body(1.0, 3), np.full((7, 7), 1.0))
    seed = seeded("F", on_body(0.5, 20), [coarse, finer], None)
    height = seed.maplet.grid.center @ UP - coarse.grid.center @ UP + seed.maplet.height
    np.testing.assert_allclose(height[14:27, 14:27], 1.0)
    # The coarser one is flat too: bent to meet the finer, it lies at the same height.
    np.testing.assert_allclose(height, 1.0, atol=1e-3)
    assert seed.sources == ("D", "C")
    alone = seeded("F", on_body(0.5, 20), [finer], None).maplet
    assert alone.valid[14:27, 14:27].all()
    assert np.isnan(alone.height[:13]).all()


def test_the_shape_meets_the_maplets_without_a_step() -> None:
    grid = on_body(0.5, 20)
    truth = shape_heights(CASTER, grid, reach=grid.radius)
    # A maplet of half the ground that lies 2 m too high, as by an error of its state.
    half = np.where(np.arange(41)[None] <= 20, truth + 2.0, np.nan)
    seed = seeded("F", grid, [Maplet("C", grid, np.broadcast_to(half, (41, 41)))], CASTER)
    whole = seed.maplet.height + (seed.maplet.grid.center - grid.center) @ grid.uz
    np.testing.assert_allclose(whole, truth + 2.0, atol=1e-3)
    assert seed.from_maplets == pytest.approx(21 / 41)
    assert seed.from_maplets + seed.from_shape == pytest.approx(1.0)


def test_maplets_make_a_surface_where_there_is_no_shape() -> None:
    around = Ground(BODY, 1.0, 12, overlap=0.35, circle=Circle(UP, 25.0))
    maplets = [of_shape("C", grid) for grid in around.grids()]
    mesh = mesh_of_maplets(maplets, 2.5)
    middle = mesh.corners.mean(axis=1)
    assert (np.sum(mesh.normals * middle, axis=1) > 0).all()
    assert CASTER.closest(middle).distance.max() < 0.5
    fine = Ground(mesh, 0.5, 12, overlap=0.35, circle=Circle(UP, 12.0))
    seeds = [seeded("F", grid, maplets, None) for grid in fine.grids()]
    for seed in seeds:
        fine.cover(seed.maplet)
    assert fine.share > 0.999
    with pytest.raises(InvalidValueError, match="heights"):
        mesh_of_maplets([], 1.0)


def mushroom() -> Mesh:
    """A body of revolution: a cap that overhangs a neck."""
    corners = [(0, -20), (8, -20), (12, -14), (10, -4), (8, 0), (14, 2), (22, 4), (22, 8), (0, 14)]
    steps = np.linspace(0, len(corners) - 1, 81)
    radius, level = (np.interp(steps, range(len(corners)), side) for side in np.transpose(corners))
    turn = np.arange(64) * np.pi / 32
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(64)], axis=-1)
    sides = radius[1:-1, None, None] * ring + level[1:-1, None, None] * np.array([0.0, 0.0, 1.0])
    index = np.arange(79 * 64).reshape(79, 64)
    east = np.roll(index, -1, axis=1)
    parts = [(index[:-1], east[:-1], east[1:]), (index[:-1], east[1:], index[1:])]
    parts += [(np.full(64, 79 * 64), east[0], index[0])]
    parts += [(np.full(64, 79 * 64 + 1), index[-1], east[-1])]
    return Mesh(
        np.vstack([sides.reshape(-1, 3), [[0, 0, -20], [0, 0, 14]]]),
        np.vstack([np.stack(part, axis=-1).reshape(-1, 3) for part in parts]),
    )


def test_ground_below_an_overhang_gets_maplets_in_the_second_pass() -> None:
    body = mushroom()
    caster = RayCaster(body)
    ground = Ground(body, 0.5, 10, overlap=0.33)
    for grid in ground.grids():
        ground.cover(seeded("X", grid, [], caster).maplet)
    first = ground.share
    assert 0.9 < first < 0.995
    further = [seeded("X", grid, [], caster, nearest=True) for grid in ground.further_grids()]
    kept = [seed.maplet for seed in further if ground.cover(seed.maplet, 0.01)]
    assert kept
    assert 1.0 - ground.share < 0.55 * (1.0 - first)
    for maplet in kept:
        points = maplet.points()[maplet.valid]
        assert caster.closest(points).distance.max() < 1e-6
