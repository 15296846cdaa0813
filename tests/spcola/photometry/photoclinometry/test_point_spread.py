"""Images that the optics blur are solved with their point spread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Waves
from scipy import ndimage

from spcola.grids import Maplet
from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import lambert
from spcola.photometry.photoclinometry import (
    HeightConstraint,
    PhotoclinometryOptions,
    solve_photoclinometry,
)

# Directions to camera and Sun.
SIGHTS = [
    ([0.3, 0.0, 1.0], [0.7, 0.1, 0.8]),
    ([-0.4, 0.2, 1.0], [-0.5, 0.4, 0.8]),
    ([0.0, 0.4, 1.0], [0.1, 0.7, 0.8]),
    ([0.1, -0.4, 1.0], [0.2, -0.6, 0.8]),
]
EDGE = 4


@pytest.fixture(scope="module")
def rough(painted) -> Waves:
    """Waves of 4 to 12 m on a grid of 0.5 m: a blur of a pixel takes a quarter of the shortest."""
    return Waves(painted.grid)


@pytest.fixture(scope="module")
def sharp(rough):
    return [
        rough.photograph(f"I{k}", toward, sun, pixel=0.5, size=90)
        for k, (toward, sun) in enumerate(SIGHTS)
    ]


def blurred(image, sigma):
    pixels = ndimage.gaussian_filter(image.pixels.astype(float), sigma)
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


def slope_error(ground, images, psf_px):
    """Error of the slopes over their root mean square, without the edges."""
    grid, truth = ground.grid, ground.heights()
    one = np.full(grid.shape, np.nan)
    one[30, 30] = truth[30, 30]
    options = PhotoclinometryOptions(
        function=lambert, least_error=1e-3, rounds=20, settled_gsd=5e-4, psf_px=psf_px
    )
    found = solve_photoclinometry(
        Maplet("FLAT", grid, np.zeros(grid.shape)), images,
        {image.name: 1e-14 * np.eye(6) for image in images},
        constraints=[HeightConstraint.of_sigma("one", one, 1e-3)], options=options,
    )  # fmt: skip
    inner = slice(EDGE, -EDGE)
    slopes, true = (np.array(slopes_of(h, grid.gsd)) for h in (found.maplet.height, truth))
    return np.linalg.norm((slopes - true)[:, inner, inner]) / np.linalg.norm(true[:, inner, inner])


@pytest.mark.parametrize(("sigma_px", "share"), [(0.5, 1.0), (1.0, 0.7)])
def test_their_point_spread_gives_back_the_relief_that_it_took(rough, sharp, sigma_px, share):
    images = [blurred(image, sigma_px) for image in sharp]
    right, without = (slope_error(rough, images, psf) for psf in (sigma_px, 0.0))
    assert right < share * without
