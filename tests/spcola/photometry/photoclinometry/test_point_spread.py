"""Images that the optics blur are solved with their point spread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Waves
from scipy import ndimage
from solved_photographs import FEW_ROUNDS, photographs_of, rms, solved_flat

from spcola.heights.slopes import slopes_of


@pytest.fixture(scope="module")
def sharp(waves):
    """Of waves of 4 to 12 m, 0.5 m a pixel: a blur of a pixel takes a quarter of the shortest."""
    return photographs_of(waves)


def blurred(image, sigma):
    pixels = ndimage.gaussian_filter(image.pixels.astype(float), sigma)
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


def error_over_two_cells(ground: Waves, found):
    """Root mean square of the errors of slopes from each point to the next but one."""
    wrong = np.array(slopes_of(found.maplet.height - ground.heights(), ground.grid.gsd))
    return rms(wrong[:, 4:-4, 4:-4])


@pytest.mark.parametrize(("sigma_px", "share"), [(0.5, 0.9), (1.0, 0.7)])
def test_their_point_spread_gives_back_the_relief_that_it_took(waves, sharp, sigma_px, share):
    images = [blurred(image, sigma_px) for image in sharp]
    right, without = (
        error_over_two_cells(waves, solved_flat(waves, images, replace(FEW_ROUNDS, psf_px=psf)))
        for psf in (sigma_px, 0.0)
    )
    assert right < share * without
