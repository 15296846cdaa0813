from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ellipsoids import ellipsoid, random_points

from spcola.errors import InvalidValueError
from spcola.formats.shapes import read_obj_mesh
from spcola.grids import MapletGrid
from spcola.shape import Mesh, covering, sample_surface
from spcola.shape.samples import Samples
from spcola.shape.uncovered import COVERED, FACING, Uncovered


def inside(
    grid: MapletGrid, points: np.ndarray, normals: np.ndarray, *, side: float, depth: float
) -> np.ndarray:
    """Return which points (N, 3) lie within `side` of the centre along Ux and Uy and face Uz.

    `depth` limits the distance from the reference plane; both in metres.
    """
    x, y, height = grid.project(points)
    return (
        (np.maximum(np.abs(x), np.abs(y)) * grid.gsd <= side)
        & (np.abs(height) <= depth)
        & (normals @ grid.uz >= FACING)
    )


def covered(mesh: Mesh, grids: list[MapletGrid], side: float) -> np.ndarray:
    points, normals = random_points(mesh, 30_000)
    found = np.zeros(len(points), dtype=bool)
    for grid in grids:
        half = grid.half_size * grid.gsd
        found |= inside(grid, points, normals, side=side * half, depth=half)
    return found


@pytest.mark.parametrize("overlap", [0.0, 0.2, 0.5])
def test_every_surface_point_lies_in_a_grid(overlap: float) -> None:
    mesh = ellipsoid(120.0, 100.0, 80.0)
    grids = covering(mesh, 1.0, 30, overlap=overlap)
    assert covered(mesh, grids, 1 - overlap).all()


def test_the_number_of_grids_is_near_what_the_area_asks_for() -> None:
    mesh = ellipsoid(120.0, 100.0, 80.0)
    area = np.linalg.norm(mesh.area_vectors, axis=1).sum()
    grids = covering(mesh, 1.0, 20, overlap=0.0)
    least = area / 40.0**2
    assert least < len(grids) < 3.5 * least


def test_grids_stand_on_the_surface_and_face_outward() -> None:
    mesh = ellipsoid(100.0, 100.0, 100.0)
    for grid in covering(mesh, 2.0, 15):
        assert np.linalg.norm(grid.center) == pytest.approx(100.0, abs=2.0)
        assert grid.uz @ grid.center / np.linalg.norm(grid.center) > 0.95
        assert (grid.gsd, grid.half_size) == (2.0, 15)


def test_each_grid_leaves_what_the_formula_says() -> None:
    samples = sample_surface(ellipsoid(50.0, 40.0, 30.0), 1.5)
    uncovered = Uncovered(samples, 7.0, 9.0)
    expected, index = np.full(len(samples.points), np.inf), 0
    for _ in range(60):
        normal = samples.normals[index]
        grid = MapletGrid.facing(samples.points[index], normal, 1.0, 10)
        squared = np.sum((samples.points - grid.center) ** 2, axis=1)
        within = inside(grid, samples.points, samples.normals, side=7.0, depth=9.0)
        expected = np.where(within | (expected < 0), COVERED, np.minimum(expected, squared))
        expected[index] = COVERED
        index = uncovered.cover(grid, index)
        np.testing.assert_allclose(uncovered.distance, expected, rtol=1e-12)
        assert index == np.argmax(expected)
    assert 0 < np.count_nonzero(expected == COVERED) < len(expected)


def test_nothing_is_left_when_all_is_covered() -> None:
    points, normals = np.array([[3.0, 0, 0]]), np.array([[1.0, 0, 0]])
    uncovered = Uncovered(Samples(points, normals, np.ones(1)), 1.0, 1.0)
    assert uncovered.cover(MapletGrid.facing(points[0], normals[0], 1.0, 3), 0) == -1


def test_mean_normal_is_that_of_all_samples_around_on_its_side() -> None:
    samples = sample_surface(ellipsoid(50.0, 40.0, 30.0), 1.5)
    uncovered = Uncovered(samples, 7.0, 9.0)
    # Larger than a cube, and on the flat side; smaller, and where it is bent most.
    for index, radius in ((0, 25.0), (int(np.argmax(samples.points[:, 0])), 4.0)):
        near = np.linalg.norm(samples.points - samples.points[index], axis=1) <= radius
        near &= samples.normals @ samples.normals[index] > 0
        mean = samples.areas[near] @ samples.normals[near]
        found = uncovered.mean_normal(index, radius)
        np.testing.assert_allclose(found, mean / np.linalg.norm(mean), atol=1e-13)


def test_mean_normal_that_a_sample_does_not_face_gives_way_to_its_own() -> None:
    points = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    normals = np.array([[0.0, 0, 1.0], [np.sqrt(0.99), 0, 0.1]])
    uncovered = Uncovered(Samples(points, normals, np.array([1.0, 1e4])), 2.0, 2.0)
    np.testing.assert_array_equal(uncovered.mean_normal(0, 3.0), normals[0])
    assert uncovered.mean_normal(1, 3.0) @ normals[1] == pytest.approx(1.0)


def test_more_overlap_takes_more_grids() -> None:
    mesh = ellipsoid(100.0, 90.0, 80.0)
    counts = [len(covering(mesh, 2.0, 15, overlap=o)) for o in (0.0, 0.3, 0.6)]
    assert counts[0] < counts[1] < counts[2]


def test_samples_carry_the_area_and_lie_within_the_step() -> None:
    mesh = ellipsoid(50.0, 40.0, 30.0, step=8)
    samples = sample_surface(mesh, 2.0)
    area = np.linalg.norm(mesh.area_vectors, axis=1).sum()
    assert samples.areas.sum() == pytest.approx(area, rel=1e-12)
    points, _ = random_points(mesh, 3000)
    nearest = [np.linalg.norm(samples.points - p, axis=1).min() for p in points[:500]]
    assert max(nearest) <= 2.0


@pytest.mark.parametrize("overlap", [-0.1, 0.9, np.nan])
def test_refuses_an_overlap_out_of_range(overlap: float) -> None:
    with pytest.raises(InvalidValueError, match="overlap"):
        covering(ellipsoid(10.0, 10.0, 10.0, step=6), 1.0, 5, overlap=overlap)


def test_refuses_a_shape_without_area() -> None:
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(InvalidValueError, match="no area"):
        covering(flat, 1.0, 5)


@pytest.mark.real_data
def test_bennu_is_covered(shared_data: Path) -> None:
    mesh = read_obj_mesh(shared_data / "bennu" / "g_12570mm_alt_obj_0000n00000_v014.obj")
    grids = covering(mesh, 1.0, 49)
    assert covered(mesh, grids, 0.8).all()
    assert len(grids) < 400
