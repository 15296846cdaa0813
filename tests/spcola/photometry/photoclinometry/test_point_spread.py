"""Images that the optics or a motion blur are solved with the blur of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photographs import Waves
from scipy import ndimage
from solved_photographs import FEW_ROUNDS, SIGHTS, photographs_of, rms, solved_flat

from spcola.heights.slopes import slopes_of
from spcola.photometry.functions import lambert
from spcola.photometry.image_blur import ImageBlur, ImageBlurs
from spcola.photometry.photoclinometry import PhotoclinometryOptions


@pytest.fixture(scope="module")
def sharp(waves):
    """Of waves of 4 to 12 m, 0.5 m a pixel: a blur of a pixel takes a quarter of the shortest."""
    return photographs_of(waves)


def blurred(image, sigma):
    pixels = ndimage.gaussian_filter(image.pixels.astype(float), sigma)
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


def errors_over_two_cells(ground: Waves, found):
    """Errors (2, R, C) of slopes from each inner point to the next but one, along x and y."""
    wrong = np.array(slopes_of(found.maplet.height - ground.heights(), ground.grid.gsd))
    return wrong[:, 4:-4, 4:-4]


def error_over_two_cells(ground: Waves, found):
    """Root mean square of these errors."""
    return rms(errors_over_two_cells(ground, found))


@pytest.mark.parametrize(("sigma_px", "share"), [(0.5, 0.9), (1.0, 0.7)])
def test_their_point_spread_gives_back_the_relief_that_it_took(waves, sharp, sigma_px, share):
    images = [blurred(image, sigma_px) for image in sharp]
    right, without = (
        error_over_two_cells(waves, solved_flat(waves, images, replace(FEW_ROUNDS, psf_px=psf)))
        for psf in (sigma_px, 0.0)
    )
    assert right < share * without


@pytest.fixture(scope="module")
def fine(waves):
    """The same ground with pixels of half the side."""
    return [
        waves.photograph(f"I{k}", *sight, pixel=0.25, samples=1, size=180)
        for k, sight in enumerate(SIGHTS)
    ]


def moved(image, fine, step, frames):
    """The mean of sub-frames, each moved by a step along samples and lines, fine pixels."""
    number = np.arange(frames) - frames // 2
    places = number[:, None] * step
    total = sum(np.roll(fine.pixels.astype(float), place, axis=(1, 0)) for place in places)
    pixels = total.reshape(90, 2, 90, 2).mean(axis=(1, 3)) / frames
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


@pytest.mark.parametrize(
    ("step", "frames", "share"), [((1, 0), 9, 0.5), ((0, 1), 9, 0.5), ((1, 1), 7, 0.8)]
)
def test_known_smear_gives_back_slopes_along_it(waves, sharp, fine, step, frames, share):
    """Every other image is smeared by 4.5 to 5 pixels, the others are sharp."""
    images = [
        moved(*pair, step, count) for *pair, count in zip(sharp, fine, [frames, 1] * 3, strict=True)
    ]  # fmt: skip
    path = (0.5 * frames * step[0], 0.5 * frames * step[1])
    smeared = ImageBlurs(tuple((image.name, ImageBlur(0.0, path)) for image in images[::2]))
    right, without = (
        errors_over_two_cells(waves, solved_flat(waves, images, replace(FEW_ROUNDS, blurs=blurs)))
        for blurs in (smeared, ImageBlurs())
    )
    along = np.array(step) / np.hypot(*step)
    assert rms(np.tensordot(along, right, 1)) < share * rms(np.tensordot(along, without, 1))


def noisy(image, noise, rng):
    pixels = image.pixels * (1.0 + noise * rng.normal(size=image.pixels.shape))
    return replace(image, pixels=np.rint(pixels).astype(np.uint16))


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.01])
@pytest.mark.parametrize("oblique", [False, True])
def test_smeared_images_never_make_sharp_ones_worse(waves, sharp, fine, oblique, noise):
    """Slopes over two cells, along the smear and across, next to those of the sharp half alone."""
    rng = np.random.default_rng(1)
    step, frames = ((1, 1), 7) if oblique else ((1, 0), 9)
    images = [
        noisy(moved(*pair, step, count), noise, rng)
        for *pair, count in zip(sharp, fine, [frames, 1] * 3, strict=True)
    ]
    path = (0.5 * frames * step[0], 0.5 * frames * step[1])
    blurs = ImageBlurs(tuple((image.name, ImageBlur(0.0, path)) for image in images[::2]))
    options = PhotoclinometryOptions(function=lambert, blurs=blurs)
    found = errors_over_two_cells(waves, solved_flat(waves, images, options))
    alone = errors_over_two_cells(waves, solved_flat(waves, images[1::2], options))
    along = np.array(step) / np.hypot(*step)
    for axis in (along, along[::-1] * (1, -1)):
        error, sharper = (rms(np.tensordot(axis, errors, 1)) for errors in (found, alone))
        assert error < 1.02 * sharper
    if noise == 0.01:
        assert rms(found) < 0.75 * rms(alone)


def test_two_cameras_are_solved_each_with_its_own_point_spread(waves, sharp):
    """A wide one and a narrow one, noise of 2 %: better than by one number, and than by one."""
    rng = np.random.default_rng(1)
    widths = [1.2, 0.3] * 3
    images = [noisy(blurred(*pair), 0.02, rng) for pair in zip(sharp, widths, strict=True)]
    options = replace(FEW_ROUNDS, least_error=0.01, settled_gsd=0.01)
    rows = ((image.name, ImageBlur(width)) for image, width in zip(images, widths, strict=True))
    own = error_over_two_cells(
        waves, solved_flat(waves, images, replace(options, blurs=ImageBlurs(tuple(rows))))
    )
    for psf in (0.0, 0.3, 0.75, 1.2):
        alike = solved_flat(waves, images, replace(options, psf_px=psf))
        assert own < 0.7 * error_over_two_cells(waves, alike)
    narrow = solved_flat(waves, images[1::2], replace(options, psf_px=0.3))
    assert own < 0.8 * error_over_two_cells(waves, narrow)
