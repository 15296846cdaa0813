"""Ground beyond a grid hides and shades it."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.grids import Maplet, MapletGrid
from spcola.photometry.photoclinometry.image_window import open_ground
from spcola.shape import RayCaster
from spcola.shape.tiling import mesh_of_maplets

GSD = 0.5


def wall(grid, *, height=4.0, step=1.0, away=4.0):
    """A maplet 20 m along −Ux of a grid, level, with a wall of 2 m across, `away` from its edge."""
    next_to = MapletGrid(grid.center - 20.0 * grid.ux, grid.axes, GSD, grid.half_size)
    heights = np.zeros(next_to.shape)
    near = -grid.half_size * GSD - away
    x = next_to.offsets * GSD - 20.0
    heights[:, (x <= near) & (x >= near - 2.0)] = height
    return RayCaster(mesh_of_maplets([Maplet("WALL", next_to, heights)], step * GSD))


@pytest.mark.parametrize("elevation", [0.2, 0.3])
def test_a_wall_on_the_next_maplet_casts_its_shadow(painted, elevation):
    """The top lies 19 m off the centre, so that shadows end H / tan(elevation) beyond it."""
    grid = painted.grid
    sun = [-np.cos(elevation), 0.0, np.sin(elevation)]
    image = painted.photograph("LOW", [0.0, 0.0, 1.0], sun, size=20)
    level = np.zeros(grid.shape)
    seen, lit = open_ground(image, grid, level, [wall(grid)], grid)
    ends = -19.0 + 4.0 / np.tan(elevation)
    expected = grid.offsets * GSD > ends
    away = np.abs(grid.offsets * GSD - ends) > 1.5 * GSD
    assert 5 < np.count_nonzero(~expected) < 50
    np.testing.assert_array_equal(lit[20:-20, away], np.tile(expected[away], (21, 1)))
    assert (seen == 1.0).all()
    # Without it, and with the Sun on the other side, all is lit.
    assert (open_ground(image, grid, level, [], grid)[1] == 1.0).all()
    other = painted.photograph("FAR", [0.0, 0.0, 1.0], [np.cos(elevation), 0.0, sun[2]], size=20)
    assert (open_ground(other, grid, level, [wall(grid)], grid)[1] == 1.0).all()


def test_a_wall_on_the_next_maplet_hides_what_lies_behind(painted):
    grid = painted.grid
    image = painted.photograph("OBLIQUE", [-1.0, 0.0, 0.3], [0.0, 0.0, 1.0], size=20)
    seen, lit = open_ground(image, grid, np.zeros(grid.shape), [wall(grid)], grid)
    hidden = (seen == 0.0).all(axis=0)
    np.testing.assert_array_equal(hidden, (seen == 0.0).any(axis=0))
    # Nearest to the wall, up to where the line of sight over its top meets the ground.
    assert hidden[0]
    assert np.count_nonzero(hidden) * GSD == pytest.approx(4.0 / 0.3 - 19.0 + 15.0, abs=1.5)
    assert (lit == 1.0).all()


@pytest.mark.parametrize("away", [1.5, 2.5, 3.5])
def test_a_wall_next_to_the_border_shades_a_coarser_grid_as_well(painted, away):
    """The grid of open ground has four times the GSD: the border is that of the finest."""
    grid, elevation = painted.grid, 0.5
    sun = [-np.cos(elevation), 0.0, np.sin(elevation)]
    image = painted.photograph("LOW", [0.0, 0.0, 1.0], sun, size=20)
    coarse = grid.with_gsd(4.0 * GSD)
    around = [wall(grid, away=away)]
    fine, rough = (
        (open_ground(image, one, np.zeros(one.shape), around, grid)[1] == 0.0).sum() * one.gsd**2
        for one in (grid, coarse)
    )
    shadow = 4.0 / np.tan(elevation) - away
    side = 2.0 * grid.half_size * GSD
    assert fine == pytest.approx(shadow * side, rel=0.2)
    assert rough == pytest.approx(shadow * side, abs=2.0 * GSD * 4.0 * side)
    assert rough > 0.25 * fine
