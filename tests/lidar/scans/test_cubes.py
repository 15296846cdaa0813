"""Cubes of space: every return in its own, to half a quantum, whatever the rest is."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.scans.cubes import (
    QUANTUM_M,
    Box,
    keep_inside,
    sort_into_cubes,
    touching_cubes,
    unpack_inside,
)
from lidar.scans.cubes.cubes import edge_of


def cloud(count: int, seed: int = 1, spread: float = 40.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 3)) * spread + [240.0, -31.0, 5.0]


@pytest.mark.parametrize("bits", [13, 16, 21, None])
def test_returns_come_back_to_half_a_quantum(bits: int | None) -> None:
    points = cloud(5000)
    cubes, order = sort_into_cubes(points, bits)
    assert sorted(order) == list(range(5000))
    assert np.abs(cubes.points() - points[order]).max() <= QUANTUM_M / 2 * (1 + 1e-9)


@pytest.mark.parametrize("bits", [13, 21])
def test_rounding_depends_on_nothing_but_the_return(bits: int) -> None:
    points = cloud(300)
    whole, order = sort_into_cubes(points)
    alone, own = sort_into_cubes(points[100:200], bits)
    back, again = np.empty_like(points), np.empty((100, 3))
    back[order], again[own] = whole.points(), alone.points()
    np.testing.assert_array_equal(back[100:200], again)


def test_what_was_rounded_once_is_not_moved_again() -> None:
    cubes, _ = sort_into_cubes(cloud(1000))
    points = cubes.points()
    again, order = sort_into_cubes(points)
    np.testing.assert_array_equal(again.points(), points[order])


def test_rows_of_a_cube_lie_in_it_and_keep_their_order() -> None:
    cubes, order = sort_into_cubes(cloud(4000), 17)
    edge = edge_of(17)
    points = cubes.points()
    for cube, first, last in zip(cubes.cube, cubes.start[:-1], cubes.start[1:], strict=True):
        assert last > first
        inside = points[first:last]
        assert (inside >= cube * edge - 1e-9).all()
        assert (inside < (cube + 1) * edge).all()
        assert (np.diff(order[first:last]) > 0).all()
    assert cubes.start[-1] == 4000
    assert len(np.unique(cubes.cube, axis=0)) == len(cubes.cube)


def turned_box(center: np.ndarray, half: float, seed: int = 3) -> Box:
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Box(center, axes, half * np.array([1.0, 0.7, 1.6]))


@pytest.mark.parametrize("reach", [0.0, 2.5])
@pytest.mark.parametrize("half", [0.5, 7.0, 300.0])
def test_all_that_is_inside_is_found(half: float, reach: float) -> None:
    points = cloud(6000)
    cubes, order = sort_into_cubes(points)
    box = turned_box(points[17] + 0.3, half)
    found, rows = np.empty((6000, 3)), np.empty(6000, dtype=np.int64)
    chosen, total = touching_cubes(cubes, box, reach)
    assert total == np.diff(cubes.start)[chosen].sum()
    count = unpack_inside(cubes, chosen, box, found, rows, reach=reach)
    # Half a quantum along three axes is what rounding may carry across a side.
    sure, maybe = (box.grown(reach + by).holds(points) for by in (-QUANTUM_M, QUANTUM_M))
    assert set(np.flatnonzero(sure)) <= set(order[rows[:count]]) <= set(np.flatnonzero(maybe))
    np.testing.assert_array_equal(found[:count], cubes.points()[rows[:count]])


def test_cubes_that_lie_apart_from_a_box_are_passed_over() -> None:
    # A full block of cubes, and a box of three of their edges.
    lattice = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    edge = edge_of(16)
    cubes, _ = sort_into_cubes((lattice + 0.5) * edge, 16)
    box = turned_box(np.zeros(3), 3.0 * edge)
    chosen, _ = touching_cubes(cubes, box)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    met = [box.holds((cube + grid) * edge).any() for cube in cubes.cube]
    assert set(np.flatnonzero(met)) <= set(chosen)
    # Two convex bodies may also lie apart along a cross product of their axes, which is not asked.
    assert len(chosen) < 1.25 * np.count_nonzero(met)


def test_what_is_inside_keeps_its_order() -> None:
    points = cloud(500)
    points[::7] = np.nan
    box = turned_box(np.array([240.0, -31.0, 5.0]), 30.0)
    inside = box.holds(points)
    kept, rows = points.copy(), np.arange(500)
    count = keep_inside(kept, rows, box)
    np.testing.assert_array_equal(rows[:count], np.flatnonzero(inside))
    np.testing.assert_array_equal(kept[:count], points[inside])
    assert 0 < count < 500


def test_a_part_holds_its_rows() -> None:
    cubes, _ = sort_into_cubes(cloud(3000), 18)
    points = cubes.points()
    for begin, end in ((0, 3000), (0, 1), (17, 18), (100, 2345), (2999, 3000)):
        part = cubes.part(begin, end)
        np.testing.assert_array_equal(part.points(), points[begin:end])
        assert (np.diff(part.start) > 0).all()


def test_cubes_are_as_large_as_the_returns_are_sparse() -> None:
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform(0, 100, (200_000, 2)), np.zeros(200_000)])
    bits = [sort_into_cubes(ground[::step])[0].bits for step in (1, 10, 100)]
    assert bits[0] < bits[1] < bits[2]
    shared = [
        len(ground[::step]) / len(sort_into_cubes(ground[::step])[0].cube) for step in (1, 10, 100)
    ]
    assert all(50 < share < 260 for share in shared)
    # Shots kilometres apart have a cube each, of the largest size.
    track = np.column_stack([np.arange(50) * 5000.0, np.zeros(50), np.zeros(50)])
    alone, _ = sort_into_cubes(track)
    assert (alone.bits, len(alone.cube)) == (21, 50)
    assert np.abs(alone.points() - track).max() <= QUANTUM_M / 2


def test_far_and_negative_places_have_room() -> None:
    points = np.array([[-2e10, 2e10, -1e-5], [0.0, -0.0, 7.5e-5], [-1e-4, 1e7, -1e7]])
    cubes, order = sort_into_cubes(points)
    # At 2e10 m doubles themselves lie 4 µm apart.
    np.testing.assert_allclose(cubes.points(), points[order], rtol=0, atol=0.6 * QUANTUM_M)


def test_nothing_is_nothing() -> None:
    cubes, order = sort_into_cubes(np.empty((0, 3)))
    assert len(order) == len(cubes.cube) == len(cubes.points()) == 0
    assert cubes.start.tolist() == [0]
