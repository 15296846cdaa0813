"""Points dealt to blocks of cells are sorted as points that go to their cells at once."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding.cells import cells, sort_into_cells, sorting
from spcola.grids import MapletGrid

GRID = MapletGrid.facing([100.0, 20.0, -40.0], [0.9, 0.2, -0.3], 0.5, 60)


def test_many_points_are_sorted_as_a_few(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    local = rng.uniform(-35, 35, (30_000, 3)) * [1.0, 1.0, 0.3]
    # Some rows of the grid remain empty, and with them whole blocks.
    local = local[(local[:, 1] < -5.0) | (local[:, 1] > 20.0)]
    points = GRID.center + local @ GRID.axes
    points[::1000] = np.nan
    few = sort_into_cells(GRID, points, 8.0)
    for module in (sorting, cells):
        monkeypatch.setattr(module, "MANY", 1000)
    many = sort_into_cells(GRID, points, 8.0)
    assert 0 < len(few.index) < len(points)
    for name in ("start", "index", "dx", "dy", "height"):
        np.testing.assert_array_equal(getattr(many, name), getattr(few, name))
    whole = many.middle
    monkeypatch.undo()
    np.testing.assert_array_equal(whole, few.middle)
    assert np.isnan(whole).any()


def test_a_grid_outside_all_points_remains_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (sorting, cells):
        monkeypatch.setattr(module, "MANY", 10)
    found = sort_into_cells(GRID, np.full((50, 3), 900.0), 5.0)
    assert len(found.index) == 0
    assert found.count.sum() == 0
    assert np.isnan(found.middle).all()
