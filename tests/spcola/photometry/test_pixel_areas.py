from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from spcola.photometry import view_of
from spcola.photometry.pixel_areas import PixelAreas

LIGHT = [0.5, 0.2, 0.8]


def areas_of(waves, pixel, height=None):
    image = waves.photograph("A", [0.5, -0.3, 1.0], LIGHT, pixel=pixel, samples=1, size=300)
    flat = np.zeros(waves.grid.shape)
    view = view_of(image, waves.grid, flat if height is None else height)
    return view, PixelAreas.of(view)


@pytest.mark.parametrize("pixel", [0.23, 0.9, 3.1])
def test_cells_fill_each_pixel_inside_and_have_their_area_in_the_image(waves, pixel):
    view, areas = areas_of(waves, pixel, waves.heights())
    whole = areas.spread(np.ones(areas.cells))
    inside = ndimage.binary_erosion(whole > 0.0, np.ones((3, 3)))
    np.testing.assert_allclose(whole[inside], 1.0, atol=1e-9)
    # The area of a quadrilateral is half the cross product of its diagonals.
    x, y = view.pixel, view.line
    one = x[1:, 1:] - x[:-1, :-1], y[1:, 1:] - y[:-1, :-1]
    other = x[1:, :-1] - x[:-1, 1:], y[1:, :-1] - y[:-1, 1:]
    expected = 0.5 * np.abs(one[0] * other[1] - one[1] * other[0])
    assert whole.sum() == pytest.approx(expected.sum(), rel=1e-9)


@pytest.mark.parametrize("pixel", [0.4, 2.0])
def test_areas_are_those_of_many_parts(waves, pixel):
    """A cell divided into 400² parts, each in one pixel."""
    view, areas = areas_of(waves, pixel)
    i, j = 17, 23
    u, v = np.meshgrid(*[(np.arange(400) + 0.5) / 400] * 2)
    weights = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
    corners = (i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)
    row, column = (
        np.rint(sum(w * layer[at] for w, at in zip(weights, corners, strict=True))).astype(int) - 1
        for layer in (view.line, view.pixel)
    )
    expected = np.zeros(areas.window)
    np.add.at(expected, (row - areas.first[0], column - areas.first[1]), 1.0 / u.size)
    only = np.zeros(areas.cells)
    only[i, j] = 1.0
    found = areas.spread(only)
    np.testing.assert_allclose(found / found.sum(), expected, atol=3e-3)


def test_ground_out_of_the_frame_has_no_areas(waves):
    image = waves.photograph("A", [0.0, 0.0, 1.0], LIGHT, pixel=1.0, samples=1, size=9)
    away = view_of(image, waves.grid, np.full(waves.grid.shape, np.nan))
    assert PixelAreas.of(away) is None
