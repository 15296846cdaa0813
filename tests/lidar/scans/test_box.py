"""Boxes in space: what they hold, what they touch, and their images."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding.cells import sort_into_cells
from lidar.scans.cubes import Box
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid


def turned(seed: int) -> np.ndarray:
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return axes


def test_corners_lie_on_the_box_and_points_beyond_do_not() -> None:
    box = Box(np.array([1.0, -2.0, 3.0]), turned(1), np.array([2.0, 0.5, 4.0]))
    away = box.corners - box.center
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(8, box.radius))
    assert box.grown(1e-9).holds(box.corners).all()
    assert not box.grown(-1e-9).holds(box.corners).any()
    assert box.holds(box.center[None]).all()
    assert not box.holds(np.full((1, 3), np.nan)).any()


def test_balls_with_a_point_inside_touch() -> None:
    rng = np.random.default_rng(2)
    box = Box(np.zeros(3), turned(3), np.array([3.0, 1.0, 2.0]))
    points = rng.uniform(-6.0, 6.0, (4000, 3))
    inside = points[box.holds(points)]
    reach = rng.uniform(0.1, 2.0, len(inside))
    away = rng.normal(size=(len(inside), 3))
    away *= (reach / np.linalg.norm(away, axis=1))[:, None]
    assert box.touches(inside + 0.999 * away, reach).all()
    assert not box.touches(np.array([[9.0, 9.0, 9.0]]), 2.0).any()


def test_all_returns_of_a_grid_lie_in_its_box_also_on_the_rim() -> None:
    grid = MapletGrid.facing([10.0, 200.0, -50.0], [0.3, 0.9, -0.2], 0.2, 7)
    rim = (grid.half_size + 0.5) * grid.gsd
    rng = np.random.default_rng(4)
    local = rng.uniform(-1.1, 1.1, (20_000, 3)) * [rim, rim, 2.0]
    local[:50, :2] = -rim * (1.0 - 1e-13)
    points = grid.center + local @ grid.axes
    cells = sort_into_cells(grid, points, 2.0)
    assert 10_000 < len(cells.index) < 20_000
    box = Box.over(grid, 2.0)
    assert box.holds(points[cells.index]).all()
    assert np.count_nonzero(box.holds(points)) <= len(cells.index) + 100


def test_the_image_of_a_box_lies_in_the_mapped_one() -> None:
    rng = np.random.default_rng(5)
    box = Box(np.array([100.0, 5.0, -3.0]), turned(6), np.array([3.0, 3.0, 8.0]))
    matrix = 1.002 * turned(7) + 1e-3 * rng.normal(size=(3, 3))

    def moved(points: np.ndarray) -> np.ndarray:
        return points @ matrix.T + [1.0, -40.0, 2.0]

    there = box.mapped(moved)
    assert there.axes @ there.axes.T == pytest.approx(np.eye(3), abs=1e-12)
    inside = box.center + (rng.uniform(-1, 1, (500, 3)) * box.half) @ box.axes
    assert there.grown(1e-9).holds(moved(inside)).all()
    # A similarity leaves no room to spare; shear by 1e-3 little.
    assert there.half == pytest.approx(1.002 * box.half, rel=0.01)


def test_a_box_has_no_negative_sides() -> None:
    with pytest.raises(InvalidValueError, match="half"):
        Box(np.zeros(3), np.eye(3), np.array([1.0, -1.0, 1.0]))
