"""Normal equations of one image against finite differences of the brightness that is expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spcola.grids import Maplet
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import PhotoclinometryOptions
from spcola.photometry.photoclinometry.image_equations import (
    ImageState,
    Sums,
    add_image,
    compare_image,
)
from spcola.photometry.photoclinometry.pixel_weights import find_inner, weigh_pixels
from spcola.photometry.photoclinometry.surface_fit import SurfaceFit

# The loss is that of squares, as no pixel counts as an outlier.
OPTIONS = PhotoclinometryOptions(function=lambert, loss_scale=1e6, levels=(1,))
# Of a nuisance parameter, and of heights in metres.
STEP = 1e-4


def along(state, surface, number, step):
    """State and surface after a step of λ, its changes along x and y, both shifts, or heights."""
    if number == 0:
        return replace(state, scale=state.scale * np.exp(step)), surface
    if number < 3:
        return replace(state, gradient=state.gradient + step * np.eye(2)[number - 1]), surface
    if number < 5:
        return replace(state, shift=state.shift + step * np.eye(2)[number - 3]), surface
    return state, replace(surface, height=surface.height + step)


@pytest.fixture(scope="module", params=[0, 5])
def seen(request, painted, photographs):
    """The window of an oblique photograph over its ground, that ground, and the image's state."""
    ground = Maplet("WAVES", painted.grid, painted.heights())
    image = photographs[request.param]
    known = {image.name: 1e-14 * np.eye(6)}
    fit = SurfaceFit.of(ground, [image], known, (), (), {}, OPTIONS)
    state = ImageState(2e4, np.array([0.03, -0.02]), np.array([0.2, -0.15]), 0.05)
    return fit.windows[0], fit.surface, state


def expected(seen, number, step):
    """Pixels that are expected after a step."""
    window, surface, state = seen
    state, surface = along(state, surface, number, step)
    return state.scale * compare_image(window, surface, state, OPTIONS).expected


@pytest.mark.parametrize("number", range(6))
def test_right_hand_sides_are_the_gradient_by_what_an_image_and_its_heights_change(seen, number):
    """Of the weighted sum of squares, where the image differs by a step from what is expected."""
    window, surface, state = seen
    before = compare_image(window, surface, state, OPTIONS)
    wanted = np.nan_to_num(expected(seen, number, STEP))
    window = replace(window, pixels=np.where(before.used, wanted, window.pixels))
    used = np.zeros(window.pixels.shape, dtype=np.bool_)
    find_inner(before.expected, before.used, used)
    weighted = np.empty((*used.shape, 5))
    dark = OPTIONS.least_brightness * float(before.expected[used].mean())
    known = state.scale, state.spread, dark, OPTIONS.loss_scale, window.block
    weigh_pixels(window.pixels, used, (before.expected, before.area, before.edge), known, weighted)
    weights = (weighted[..., 0] * before.area)[used]
    changes = (expected(seen, number, STEP) - expected(seen, number, -STEP))[used] / (2.0 * STEP)
    gradient = float(np.sum(weights * changes**2)) * STEP
    sums = Sums.empty(1, surface.albedo.shape)
    add_image(sums, 0, window, surface, state, OPTIONS, rescale=False)
    # Of the unknowns of cells the third is the height.
    right = float(sums.right[2].sum()) if number == 5 else float(sums.nuisance[0, number, -1])
    if number < 3:
        assert right == pytest.approx(gradient, rel=0.002)
    else:
        # Differences over two pixels are flatter than short waves; the next round has the rest.
        assert 0.8 < right / gradient < 1.0
