"""Counting sort and per-cell statistics against plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidar.gridding.cells import CellReturns, sort_into_cells
from lidar.gridding.cells.cells import CorrectedMedians
from spcola.grids import MapletGrid

GRID = MapletGrid.facing([210.0, -40.0, 60.0], [0.9, -0.1, 0.3], 0.25, 6)


def scattered(rng: np.random.Generator, count: int, width: float = 7.5) -> np.ndarray:
    x, y = rng.uniform(-width, width, (2, count))
    height = rng.normal(0.0, 0.4, count)
    plane = GRID.gsd * (x[:, None] * GRID.ux + y[:, None] * GRID.uy)
    return GRID.center + plane + height[:, None] * GRID.uz


def reference_cells(points: np.ndarray, reach: float) -> dict[tuple[int, int], list[int]]:
    """Indices of the points in each cell (row, column), by one loop."""
    cells: dict[tuple[int, int], list[int]] = {}
    for index, point in enumerate(points):
        x, y, height = GRID.project(point)
        n, m = math.floor(x + 0.5), math.floor(y + 0.5)
        if max(abs(n), abs(m)) <= GRID.half_size and abs(height) <= reach:
            cells.setdefault((m + GRID.half_size, n + GRID.half_size), []).append(index)
    return cells


@pytest.mark.parametrize("seed", [1, 2])
def test_cells_hold_what_a_loop_finds(seed):
    points = scattered(np.random.default_rng(seed), 2000)
    cells = sort_into_cells(GRID, points, 0.9)
    want = reference_cells(points, 0.9)
    assert len(cells.index) < len(points)
    for row in range(GRID.size):
        for column in range(GRID.size):
            c = row * GRID.size + column
            found = cells.index[cells.start[c] : cells.start[c + 1]]
            assert list(found) == want.get((row, column), [])
    assert np.array_equal(cells.count, np.diff(cells.start).reshape(GRID.shape))


def test_offsets_and_heights_are_those_of_the_projection():
    points = scattered(np.random.default_rng(3), 500)
    cells = sort_into_cells(GRID, points, 10.0)
    x, y, height = GRID.project(points[cells.index])
    row, column = np.divmod(cells.cell, GRID.size)
    # Sums of three products, in whatever order: a few units in the last place of 200 m.
    np.testing.assert_allclose(cells.dx, x - (column - GRID.half_size), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(cells.dy, y - (row - GRID.half_size), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(cells.height, height, rtol=0.0, atol=1e-12)
    assert np.abs(cells.dx).max() <= 0.5
    assert np.abs(cells.dy).max() <= 0.5


def test_statistics_equal_numpys_exactly():
    rng = np.random.default_rng(4)
    cells = sort_into_cells(GRID, scattered(rng, 3000), 10.0)
    values = rng.normal(1e3, 1.0, len(cells.index))
    median, mean = cells.medians(values), cells.means(values)
    spread = cells.spreads(values, median)
    for c in range(GRID.size**2):
        mine = values[cells.start[c] : cells.start[c + 1]]
        where = np.unravel_index(c, GRID.shape)
        if len(mine) == 0:
            assert np.isnan([median[where], mean[where], spread[where]]).all()
            continue
        assert median[where] == np.median(mine)
        assert mean[where] == math.fsum(mine) / len(mine)
        assert spread[where] == 1.482602218505602 * np.median(np.abs(mine - np.median(mine)))


def test_statistics_do_not_depend_on_the_order_of_returns():
    rng = np.random.default_rng(6)
    points = scattered(rng, 3000)
    one, other = (
        sort_into_cells(GRID, p, 10.0) for p in (points, points[rng.permutation(len(points))])
    )
    assert np.array_equal(one.medians(one.height), other.medians(other.height), equal_nan=True)
    assert np.array_equal(one.means(one.height), other.means(other.height), equal_nan=True)


def test_selected_returns_keep_their_cells():
    cells = sort_into_cells(GRID, scattered(np.random.default_rng(7), 2000), 10.0)
    keep = np.random.default_rng(8).random(len(cells.index)) < 0.4
    chosen = cells.select(keep)
    assert isinstance(chosen, CellReturns)
    assert np.array_equal(chosen.cell, cells.cell[keep])
    assert np.array_equal(chosen.index, cells.index[keep])
    assert np.array_equal(chosen.height, cells.height[keep])


def test_returns_are_moved_together_in_their_own_memory():
    cells = sort_into_cells(GRID, scattered(np.random.default_rng(7), 2000), 10.0)
    keep = np.random.default_rng(8).random(len(cells.index)) < 0.9
    chosen = cells.select(keep)
    reduced = cells.reduced(keep)
    for layer in ("start", "dx", "dy", "height", "index"):
        assert np.array_equal(getattr(reduced, layer), getattr(chosen, layer)), layer
    assert np.shares_memory(reduced.height, cells.height)
    assert not np.shares_memory(chosen.height, cells.height)


def test_what_is_known_of_cells_that_lost_nothing_is_kept():
    """… and is the same as if it had been found anew; cells that lost all have none."""
    cells = sort_into_cells(GRID, scattered(np.random.default_rng(8), 5000), 5.0)
    keep = np.random.default_rng(9).random(len(cells.index)) > 0.05
    keep[cells.cell == cells.cell[0]] = False
    anew = cells.select(keep)
    assert not {"place", "middle"} & vars(anew).keys()
    assert np.isfinite(cells.middle).any()
    assert np.isfinite(cells.place).any()
    kept = cells.select(keep)
    assert {"place", "middle"} <= vars(kept).keys()
    assert np.array_equal(kept.middle, anew.middle, equal_nan=True)
    assert np.array_equal(kept.place, anew.place, equal_nan=True)
    assert np.isnan(kept.middle.ravel()[cells.cell[0]])


def test_medians_are_taken_over_where_cells_lost_nothing():
    """… and are the same as if they had been taken anew."""
    cells = sort_into_cells(GRID, scattered(np.random.default_rng(8), 5000), 5.0)
    rng = np.random.default_rng(9)
    slopes = rng.normal(size=(2, *cells.shape))
    first = CorrectedMedians(cells, 1e-6)
    first.at(*slopes)
    left = cells.select(rng.random(len(cells.index)) > 0.02)
    np.testing.assert_array_equal(
        CorrectedMedians(left, 1e-6, first).at(*slopes), CorrectedMedians(left, 1e-6).at(*slopes)
    )


def test_no_returns_give_empty_cells():
    cells = sort_into_cells(GRID, np.empty((0, 3)), 10.0)
    assert cells.count.sum() == 0
    assert np.isnan(cells.medians(cells.height)).all()
