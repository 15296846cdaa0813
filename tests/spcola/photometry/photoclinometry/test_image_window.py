"""Ground beyond a grid hides and shades it."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.grids import Maplet, MapletGrid
from spcola.photometry.photoclinometry.image_window import open_ground
from spcola.shape import RayCaster
from spcola.shape.tiling import mesh_of_maplets

GSD = 0.5


def wall(grid, *, height=4.0, step=1.0):
    """A maplet 20 m along −Ux of a grid, level, with a wall of 2 m across on its middle line."""
    next_to = MapletGrid(grid.center - 20.0 * grid.ux, grid.axes, GSD, grid.half_size)
    heights = np.zeros(next_to.shape)
    middle = grid.half_size
    heights[:, middle - 2 : middle + 3] = height
    return RayCaster(mesh_of_maplets([Maplet("WALL", next_to, heights)], step * GSD))


@pytest.mark.parametrize("elevation", [0.2, 0.3])
def test_a_wall_on_the_next_maplet_casts_its_shadow(painted, elevation):
    """The top lies 19 m off the centre, so that shadows end H / tan(elevation) beyond it."""
    grid = painted.grid
    sun = [-np.cos(elevation), 0.0, np.sin(elevation)]
    image = painted.photograph("LOW", [0.0, 0.0, 1.0], sun, size=20)
    level = np.zeros(grid.shape)
    seen, lit = open_ground(image, grid, level, [wall(grid)])
    ends = -19.0 + 4.0 / np.tan(elevation)
    expected = grid.offsets * GSD > ends
    away = np.abs(grid.offsets * GSD - ends) > 1.5 * GSD
    assert 5 < np.count_nonzero(~expected) < 50
    np.testing.assert_array_equal(lit[20:-20, away], np.tile(expected[away], (21, 1)))
    assert (seen == 1.0).all()
    # Without it, and with the Sun on the other side, all is lit.
    assert (open_ground(image, grid, level, [])[1] == 1.0).all()
    other = painted.photograph("FAR", [0.0, 0.0, 1.0], [np.cos(elevation), 0.0, sun[2]], size=20)
    assert (open_ground(other, grid, level, [wall(grid)])[1] == 1.0).all()


def test_a_wall_on_the_next_maplet_hides_what_lies_behind(painted):
    grid = painted.grid
    image = painted.photograph("OBLIQUE", [-1.0, 0.0, 0.3], [0.0, 0.0, 1.0], size=20)
    seen, lit = open_ground(image, grid, np.zeros(grid.shape), [wall(grid)])
    hidden = (seen == 0.0).all(axis=0)
    np.testing.assert_array_equal(hidden, (seen == 0.0).any(axis=0))
    # Nearest to the wall, up to where the line of sight over its top meets the ground.
    assert hidden[0]
    assert np.count_nonzero(hidden) * GSD == pytest.approx(4.0 / 0.3 - 19.0 + 15.0, abs=1.5)
    assert (lit == 1.0).all()
