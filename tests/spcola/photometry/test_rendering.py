from __future__ import annotations

import numpy as np
import pytest

from spcola.photometry import ortho_rectify, render_view, view_of
from spcola.photometry.functions import lambert, lommel_seeliger

LIGHT = [0.5, 0.2, 0.8]


def test_flat_ground_has_the_brightness_of_the_function(waves):
    image = waves.photograph("A", [0.2, 0.0, 1.0], LIGHT, samples=1, pixel=0.2)
    flat = np.zeros(waves.grid.shape)
    view = view_of(image, waves.grid, flat)
    sun = waves.grid.axes @ image.sun
    found = render_view(view, function=lambert)
    inside = np.isfinite(found)
    assert inside[2:-2, 2:-2].all()
    np.testing.assert_allclose(found[inside], sun[2], atol=1e-12)
    bright = render_view(view, function=lommel_seeliger, albedo=np.full(flat.shape, 1.2))
    eye = view.cos_emission[5, 5]
    assert bright[5, 5] == pytest.approx(1.2 * 2 * sun[2] / (sun[2] + eye), rel=1e-4)


@pytest.mark.parametrize("pixel", [0.2, 0.5, 1.0])
def test_a_rendering_looks_like_the_photograph(waves, pixel):
    """Shot by rays at the same surface: only what the grid does not hold is different."""
    image = waves.photograph("A", [0.4, -0.3, 1.0], LIGHT, pixel=pixel, size=200)
    view = view_of(image, waves.grid, waves.heights())
    shown, rendered = (
        ortho_rectify(image, view).brightness / 20000.0,
        render_view(view, function=lambert),
    )
    both = np.isfinite(shown) & np.isfinite(rendered)
    both[:4], both[-4:], both[:, :4], both[:, -4:] = False, False, False, False
    rest = (shown - rendered)[both]
    assert both.sum() > 2000
    assert abs(np.mean(rest)) < 0.002
    assert np.std(rest) < 0.25 * np.std(shown[both])


def test_shadow_is_dark_and_unknown_ground_unknown(waves):
    height = np.zeros(waves.grid.shape)
    height[:, 30] = 3.0
    height[5, 5] = np.nan
    image = waves.photograph("A", [0.0, 0.0, 1.0], [-1.0, 0.0, 1.0], samples=1, pixel=0.3)
    rendered = render_view(view_of(image, waves.grid, height), function=lambert)
    assert np.isnan(rendered[5, 5])
    assert (rendered[30, 32:35] == 0.0).all()
    assert (rendered[30, 40:50] > 0.5).all()
