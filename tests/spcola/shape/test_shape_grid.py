from __future__ import annotations

import numpy as np
import pytest

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.shape import Mesh, RayCaster, shape_heights

TWO_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])


def sheet(height: float, half: float = 100.0) -> FloatArray:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float) * half
    return corners + np.array([0.0, 0.0, height])


@pytest.fixture
def grid() -> MapletGrid:
    return MapletGrid.facing([0.0, 0, 0], [0.0, 0, 1], 1.0, 10)


def test_a_tilted_plane_gives_its_heights(grid: MapletGrid) -> None:
    corners = sheet(0.0)
    corners[:, 2] = 1.5 + 0.1 * corners[:, 0] - 0.2 * corners[:, 1]
    heights = shape_heights(RayCaster(Mesh(corners, TWO_TRIANGLES)), grid, reach=10.0)
    nodes = grid.points(np.zeros(grid.shape))
    np.testing.assert_allclose(heights, 1.5 + 0.1 * nodes[..., 0] - 0.2 * nodes[..., 1], atol=1e-12)


def test_rows_run_along_uy() -> None:
    grid = MapletGrid([0.0, 0, 0], np.eye(3), 1.0, 5)
    corners = sheet(0.0)
    corners[:, 2] = 0.5 * corners[:, 1]
    heights = shape_heights(RayCaster(Mesh(corners, TWO_TRIANGLES)), grid, reach=10.0)
    np.testing.assert_allclose(heights, 0.5 * grid.offsets[:, None] * np.ones(11), atol=1e-12)


def test_outermost_and_nearest_of_several_sheets(grid: MapletGrid) -> None:
    vertices = np.vstack([sheet(-1.0), sheet(4.0), sheet(30.0)])
    facets = np.vstack([TWO_TRIANGLES + 4 * k for k in range(3)])
    caster = RayCaster(Mesh(vertices, facets))
    for reach, surface, expected in (
        (40.0, "outermost", 30.0),
        (10.0, "outermost", 4.0),
        (10.0, "nearest", -1.0),
        (0.5, "nearest", np.nan),
        (0.5, "outermost", np.nan),
    ):
        heights = shape_heights(caster, grid, reach=reach, surface=surface)  # type: ignore[arg-type]
        np.testing.assert_allclose(heights, expected, atol=1e-10)


def test_nan_outside_the_shape_and_for_a_surface_seen_from_within(grid: MapletGrid) -> None:
    small = RayCaster(Mesh(sheet(1.0, half=5.5), TWO_TRIANGLES))
    heights = shape_heights(small, grid, reach=3.0)
    inside = np.max(np.abs(np.stack(np.meshgrid(grid.offsets, grid.offsets))), axis=0) <= 5
    np.testing.assert_array_equal(np.isfinite(heights), inside)
    downward = RayCaster(Mesh(sheet(1.0), TWO_TRIANGLES[:, ::-1]))
    assert np.isnan(shape_heights(downward, grid, reach=3.0)).all()


@pytest.mark.parametrize("reach", [0.0, -1.0, np.nan])
def test_refuses_a_reach_that_is_not_positive(grid: MapletGrid, reach: float) -> None:
    caster = RayCaster(Mesh(sheet(1.0), TWO_TRIANGLES))
    with pytest.raises(InvalidValueError, match="reach"):
        shape_heights(caster, grid, reach=reach)
