from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from spcola.arrays import FloatArray, IntArray
from spcola.errors import InvalidValueError
from spcola.formats.shapes import read_obj_mesh
from spcola.shape import Mesh, RayCaster
from spcola.shape.rays import facets_around_vertices, intersect, refine


def lumpy(step: int = 24, radius: float = 250.0, seed: int = 5) -> Mesh:
    """A closed body of latitude-longitude triangles with bumps; radius in metres."""
    rng = np.random.default_rng(seed)
    lat, lon = (
        np.linspace(-np.pi / 2, np.pi / 2, step + 1)[1:-1],
        np.arange(2 * step) * np.pi / step,
    )
    grid_lat, grid_lon = np.meshgrid(lat, lon, indexing="ij")
    reach = radius * (1 + 0.1 * np.cos(3 * grid_lon) * np.cos(grid_lat) ** 3)
    reach = reach + rng.normal(0, 2.0, reach.shape)
    ring = (
        np.stack(
            [
                np.cos(grid_lat) * np.cos(grid_lon),
                np.cos(grid_lat) * np.sin(grid_lon),
                np.sin(grid_lat),
            ],
            axis=-1,
        )
        * reach[..., None]
    )
    vertices = np.vstack([ring.reshape(-1, 3), [[0, 0, -radius], [0, 0, radius]]])
    rows, columns = ring.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    east = np.roll(index, -1, axis=1)
    south, north = rows * columns, rows * columns + 1
    facets = np.vstack([
        np.stack([index[:-1], east[:-1], east[1:]], axis=-1).reshape(-1, 3),
        np.stack([index[:-1], east[1:], index[1:]], axis=-1).reshape(-1, 3),
        np.stack([np.full(columns, south), east[0], index[0]], axis=-1),
        np.stack([np.full(columns, north), index[-1], east[-1]], axis=-1),
    ])  # fmt: skip
    return Mesh(vertices, facets, "lumpy")


def brute(mesh: Mesh, origins: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
    """Nearest hit by solving the 3x3 system of every ray with every facet."""
    a, b, c = mesh.corners.transpose(1, 0, 2)
    distance = np.full(len(origins), np.nan)
    facet = np.full(len(origins), -1)
    for i, (origin, way) in enumerate(zip(origins, directions, strict=True)):
        unit = way / np.linalg.norm(way)
        matrix = np.stack([b - a, c - a, np.broadcast_to(-unit, a.shape)], axis=-1)
        solution = np.linalg.solve(matrix, (origin - a)[..., None])[..., 0]
        u, v, t = solution.T
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)
        if met.any():
            facet[i] = np.flatnonzero(met)[np.argmin(t[met])]
            distance[i] = t[facet[i]]
    return distance, facet


@pytest.fixture(scope="module")
def body() -> Mesh:
    return lumpy()


@pytest.fixture(scope="module")
def caster(body: Mesh) -> RayCaster:
    return RayCaster(body)


def surface_points(mesh: Mesh, count: int, seed: int) -> tuple[FloatArray, IntArray]:
    rng = np.random.default_rng(seed)
    facet = rng.choice(len(mesh.facets), count)
    inside = rng.dirichlet([2.0, 2.0, 2.0], count)
    return np.einsum("nk,nkj->nj", inside, mesh.corners[facet]), facet


def test_agrees_with_brute_force_hit_or_miss(body: Mesh, caster: RayCaster) -> None:
    rng = np.random.default_rng(1)
    origins = rng.normal(0, 500.0, (500, 3))
    directions = rng.normal(0, 200.0, (500, 3)) - origins
    hits = caster.cast(origins, directions)
    distance, facet = brute(body, origins, directions)
    np.testing.assert_array_equal(hits.facet, facet)
    np.testing.assert_allclose(hits.distance, distance, atol=1e-9)
    assert 0.1 < hits.hit.mean() < 0.95


@pytest.mark.parametrize("far", [1e3, 1e5, 1e8])
def test_error_is_below_a_micrometre_from_any_distance(
    body: Mesh, caster: RayCaster, far: float
) -> None:
    points, facet = surface_points(body, 20_000, 2)
    origins = points + far * body.normals[facet]
    hits = caster.cast(origins, points - origins)
    clear = hits.facet == facet
    assert clear.mean() > 0.9
    limit = max(1e-9, 20 * np.spacing(far))
    assert np.abs(hits.points - points)[clear].max() < max(limit, 1e-9)
    assert limit < 1e-6
    # what is met instead stands in front, as a hill would
    assert np.all(hits.distance[~clear] < np.linalg.norm(points - origins, axis=1)[~clear] + limit)


def test_no_ray_slips_through_an_edge_or_a_vertex(body: Mesh, caster: RayCaster) -> None:
    a, b, _ = body.corners.transpose(1, 0, 2)
    share = np.random.default_rng(3).uniform(size=(len(a), 1))
    for target in (a, a + share * (b - a)):
        hits = caster.cast(np.zeros(3), target)
        assert hits.hit.all()
        np.testing.assert_allclose(hits.distance, np.linalg.norm(target, axis=1), atol=1e-9)


def test_hits_lie_on_their_ray_and_facet(body: Mesh, caster: RayCaster) -> None:
    rng = np.random.default_rng(4)
    origins = rng.normal(0, 2000.0, (5000, 3))
    hits = caster.cast(origins, rng.normal(0, 100.0, (5000, 3)) - origins)
    met = hits.hit
    a = body.corners[hits.facet[met], 0]
    off_plane = np.sum((hits.points[met] - a) * hits.normals[met], axis=1)
    assert np.abs(off_plane).max() < 1e-9
    np.testing.assert_allclose(
        np.linalg.norm(hits.points[met] - origins[met], axis=1), hits.distance[met], atol=1e-9
    )


def test_misses_and_rays_that_are_not_finite(caster: RayCaster) -> None:
    origins = np.array([[1e4, 0, 0], [1e4, 0, 0], [np.nan, 0, 0], [1e4, 0, 0]])
    directions = np.array([[1.0, 0, 0], [0, 1.0, 0], [1.0, 0, 0], [0.0, 0, 0]])
    hits = caster.cast(origins, directions)
    assert not hits.hit.any()
    assert np.isnan(hits.distance).all()
    assert np.isnan(hits.points).all()
    assert np.isnan(hits.normals).all()
    assert len(caster.cast(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


def test_distance_does_not_depend_on_the_length_of_the_direction(caster: RayCaster) -> None:
    one = caster.cast([[1000.0, 30.0, 20.0]], [[-1.0, 0.0, 0.0]])
    other = caster.cast([1000.0, 30.0, 20.0], [[-7e5, 0.0, 0.0]])
    assert one.distance[0] == pytest.approx(other.distance[0], abs=1e-12)


def test_a_translated_body_is_met_at_translated_points(body: Mesh, caster: RayCaster) -> None:
    shift = np.array([1e4, -2e4, 3e4])
    moved = RayCaster(Mesh(body.vertices + shift, body.facets))
    points, facet = surface_points(body, 2000, 6)
    origins = points + 3e3 * body.normals[facet]
    here = caster.cast(origins, points - origins)
    there = moved.cast(origins + shift, points - origins)
    np.testing.assert_array_equal(here.facet, there.facet)
    np.testing.assert_allclose(here.points + shift, there.points, atol=1e-7)


def test_occlusion(body: Mesh, caster: RayCaster) -> None:
    points, facet = surface_points(body, 3000, 7)
    station = np.array([5000.0, 0.0, 0.0])
    hidden = caster.occluded(np.broadcast_to(station, points.shape), points)
    facing = np.sum(body.normals[facet] * (station - points), axis=1) > 0
    assert hidden[~facing].all()
    distance, _ = brute(body, np.broadcast_to(station, points[:300].shape), points[:300] - station)
    expected = distance < np.linalg.norm(points[:300] - station, axis=1) - 1e-3
    np.testing.assert_array_equal(hidden[:300], expected)
    assert caster.occluded([[np.nan, 0, 0]], [[0.0, 0, 0]])[0]


def test_occlusion_between_points_on_opposite_sides(caster: RayCaster) -> None:
    assert caster.occluded([[900.0, 0, 0]], [[-900.0, 0, 0]])[0]
    assert not caster.occluded([[900.0, 900.0, 0]], [[900.0, -900.0, 0]])[0]


def test_kernel_looks_at_neighbours_of_a_wrong_facet(body: Mesh) -> None:
    starts, around = facets_around_vertices(body.facets, len(body.vertices))
    target = body.corners.mean(axis=1)
    origins = target + 50.0 * body.normals
    shared = {int(v) for v in body.facets[100]}
    ring = [f for f, v in enumerate(body.facets) if shared & {int(x) for x in v}]
    for wrong in ring:
        distance, facet = refine(
            (origins[100:101], -body.normals[100:101], np.array([49.0]), np.array([wrong])),
            (np.array(body.vertices), np.ascontiguousarray(body.facets)),
            (starts, around),
            (1e-3, 1e-10),
        )
        assert facet[0] == 100
        assert distance[0] == pytest.approx(50.0, abs=1e-10)


def test_intersection_equals_its_formula() -> None:
    rng = np.random.default_rng(8)
    for _ in range(200):
        origin, way, a, b, c = rng.normal(size=(5, 3))
        way /= np.linalg.norm(way)
        t, inside = intersect(origin, way, a, b, c)
        u, v, expected = np.linalg.solve(np.stack([b - a, c - a, -way], axis=1), origin - a)
        assert t == pytest.approx(expected, rel=1e-9)
        assert (inside >= 0) == (u >= 0 and v >= 0 and u + v <= 1)


def test_a_ray_along_the_plane_meets_nothing() -> None:
    a, b, c = np.eye(3)[0], np.eye(3)[1], np.zeros(3)
    t, inside = intersect(np.array([-1.0, 0, 0]), np.array([1.0, 0, 0]), a, b, c)
    assert np.isnan(t)
    assert inside == -np.inf


def test_refuses_a_mesh_without_facets_and_wrong_shapes(caster: RayCaster) -> None:
    with pytest.raises(InvalidValueError, match="no facet"):
        RayCaster(Mesh(np.zeros((3, 3)), np.zeros((0, 3), dtype=int)))
    with pytest.raises(InvalidValueError, match="directions"):
        caster.cast([0.0, 0, 0], [1.0, 0, 0])


def test_a_caster_can_be_sent_to_another_process(caster: RayCaster) -> None:
    copy = pickle.loads(pickle.dumps(caster))
    assert copy.cast([900.0, 0, 0], [[-1.0, 0, 0]]).distance[0] > 0


@pytest.mark.real_data
def test_bennu_is_met_from_7_km_to_a_micrometre(shared_data: Path) -> None:
    mesh = read_obj_mesh(shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj")
    points, facet = surface_points(mesh, 50_000, 9)
    origins = points + 7000.0 * mesh.normals[facet]
    hits = RayCaster(mesh).cast(origins, points - origins)
    clear = hits.facet == facet
    assert clear.mean() > 0.99
    assert np.abs(hits.points - points)[clear].max() < 1e-9
