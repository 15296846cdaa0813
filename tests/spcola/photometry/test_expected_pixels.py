from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.photometry import view_of
from spcola.photometry.expected_pixels import expected_pixels
from spcola.photometry.image_blur import ImageBlur

LIGHT = [0.5, 0.2, 0.8]


def seen_from(waves, toward, *, pixel, height=None, size=160):
    image = waves.photograph("A", toward, LIGHT, pixel=pixel, samples=1, size=size)
    flat = np.zeros(waves.grid.shape)
    return view_of(image, waves.grid, flat if height is None else height)


def cells(waves, value):
    return np.full((waves.grid.size - 1,) * 2, value)


@pytest.mark.parametrize("pixel", [0.12, 0.5, 1.7])
def test_even_ground_fills_its_pixels_evenly(waves, pixel):
    view = seen_from(waves, [0.6, 0.2, 1.0], pixel=pixel, size=300)
    found = expected_pixels(view, cells(waves, 3.0))
    np.testing.assert_allclose(found.value, 3.0)
    area = abs(np.linalg.det(view.footprint)) * (waves.grid.size - 1) ** 2
    assert found.known.sum() == pytest.approx(area, rel=0.08)


def test_a_pixel_holds_the_mean_of_its_cells_by_their_area_in_the_image(waves):
    """A roof, its two sides of unlike brightness, under one large pixel after another."""
    grid = waves.grid
    x = grid.offsets * grid.gsd
    height = np.tile(-0.5 * np.abs(x), (grid.size, 1))
    bright = cells(waves, 1.0)
    bright[:, : grid.half_size] = 2.0
    view = seen_from(waves, [1.0, 0.0, 1.0], pixel=4.0, height=height, size=9)
    found = expected_pixels(view, bright)
    ridge = np.array([layer[grid.half_size, grid.half_size] for layer in (view.line, view.pixel)])
    row, column = np.rint(ridge - 1.0 - found.first).astype(int)
    # Half of the pixel each, though three times as much ground on the side that turns away.
    assert found.known[row, column]
    assert found.value[row, column] == pytest.approx(1.5, abs=0.05)


def test_gaps_are_bridged_and_edges_are_not(waves):
    height = np.zeros(waves.grid.shape)
    whole = expected_pixels(seen_from(waves, [0.0, 0.0, 1.0], pixel=1.3), cells(waves, 1.0))
    height[20:22, 30:32] = height[35:43, 12:20] = np.nan
    view = seen_from(waves, [0.0, 0.0, 1.0], pixel=1.3, height=height)
    bright = np.where(np.isfinite(view.cos_incidence), 1.0, np.nan)
    found = expected_pixels(view, bright)
    np.testing.assert_array_equal(found.first, whole.first)
    assert 4 <= np.count_nonzero(whole.known & ~found.known) <= 10
    for border in (whole.known[0], whole.known[-1], whole.known[:, 0], whole.known[:, -1]):
        assert not border.any()


@pytest.mark.parametrize(
    ("blur", "added"), [(ImageBlur(1.5), 1.5**2), (ImageBlur(0.6, (2.0, 6.0)), 0.6**2 + 3.0)]
)
def test_optics_and_motion_spread_a_bright_cell(waves, blur, added):
    view = seen_from(waves, [0.0, 0.0, 1.0], pixel=0.5)
    bright = cells(waves, 0.0)
    bright[28, 28] = 1.0
    sharp, soft = (expected_pixels(view, bright, blur=one) for one in (None, blur))
    lines = np.arange(sharp.value.shape[0], dtype=float)

    def variance(found):
        share = np.where(found.known, found.value, 0.0).sum(axis=1)
        share /= share.sum()
        return share @ lines**2 - (share @ lines) ** 2

    assert variance(soft) - variance(sharp) == pytest.approx(added, rel=0.05)


def test_ground_that_is_not_seen_gives_nothing(waves):
    view = seen_from(waves, [0.0, 0.0, 1.0], pixel=0.5)
    nowhere = replace(view, seen=np.zeros_like(view.seen))
    assert not expected_pixels(nowhere, cells(waves, 1.0)).known.any()
