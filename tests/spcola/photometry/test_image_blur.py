"""Blur of images: what a point spread and a smear do to waves, and which image has which."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from spcola.errors import InvalidValueError, SettingsError
from spcola.photometry.image_blur import ImageBlur, ImageBlurs

RNG = np.random.default_rng(5)
PATHS = [(1.0, 0.0), (0.7, 0.4), (0.0, -3.0), (2.0, 1.0), (4.0, -4.0), (12.0, 5.0)]


def kernel_of(blur, *, block=1):
    """What a point gives to the pixels around it, and their lines and samples."""
    point = np.zeros((61, 61))
    point[30, 30] = 1.0
    places = np.indices(point.shape) - 30
    return blur.applied(point, (0, 1), block=block), places


def second_moments(blur):
    """Of a point spread σ and a smear d along samples and lines, pixels²: σ² I + d dᵀ / 12."""
    path = np.array(blur.smear_px)
    return blur.psf_px**2 * np.eye(2) + np.outer(path, path) / 12.0


def worst_contrast(blur, wave_px):
    """Largest error of the contrast of waves of so many pixels, of any direction."""
    kernel, (line, sample) = kernel_of(blur)
    wrong = []
    for turn in np.linspace(0.0, np.pi, 37):
        u, v = 2.0 * np.pi / wave_px * np.array([np.cos(turn), np.sin(turn)])
        phase = 0.5 * (u * blur.smear_px[0] + v * blur.smear_px[1])
        right = np.exp(-0.5 * blur.psf_px**2 * (u**2 + v**2)) * np.sinc(phase / np.pi)
        wrong.append(np.sum(kernel * np.cos(u * sample + v * line)) - right)
    return np.abs(wrong).max()


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("psf", [0.5, 0.79, 0.8, 2.0])
def test_waves_of_four_pixels_lose_the_contrast_that_point_spread_and_smear_take(psf, path):
    assert worst_contrast(ImageBlur(psf, path), 4.0) < 0.01


@pytest.mark.parametrize("path", PATHS)
def test_smear_of_a_sharp_image_is_right_for_long_waves(path):
    """Pixels cannot express an oblique path more sharply with positive weights."""
    blur = ImageBlur(0.0, path)
    assert worst_contrast(blur, 4.0) < 0.1
    assert worst_contrast(blur, 8.0) < 0.03
    assert worst_contrast(blur, 16.0) < 0.008


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("psf", [0.0, 0.6, 1.5])
def test_light_is_kept_where_it_was_and_nothing_is_negative(psf, path):
    blur = ImageBlur(psf, path)
    kernel, (line, sample) = kernel_of(blur)
    assert kernel.min() >= 0.0
    assert kernel.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(kernel, kernel[::-1, ::-1])
    moments = [
        [np.sum(kernel * a * b) for b in (sample, line)] for a in (sample, line)
    ]  # fmt: skip
    np.testing.assert_allclose(moments, second_moments(blur), atol=0.15 if psf == 0.0 else 0.01)


def test_what_pixels_take_is_what_they_give():
    one, other = RNG.uniform(size=(2, 30, 40))
    for blur in (ImageBlur(1.2), ImageBlur(0.4, (5.0, 2.0)), ImageBlur(1.0, (-7.0, 3.0))):
        given, taken = (blur.applied(layer, (0, 1)) for layer in (one, other))
        assert np.sum(given * other) == pytest.approx(np.sum(one * taken), rel=1e-12)


def test_sign_of_a_smear_and_order_of_axes_do_not_matter():
    layers = RNG.uniform(size=(3, 30, 40))
    blur = ImageBlur(0.5, (3.0, 1.0))
    found = blur.applied(layers, (1, 2))
    np.testing.assert_array_equal(found, ImageBlur(0.5, (-3.0, -1.0)).applied(layers, (1, 2)))
    last = blur.applied(np.moveaxis(layers, 0, 2).copy(), (0, 1))
    np.testing.assert_array_equal(found, np.moveaxis(last, 2, 0))


def test_blocks_of_pixels_are_blurred_less():
    found, _ = kernel_of(ImageBlur(2.0, (6.0, 2.0)), block=4)
    expected, _ = kernel_of(ImageBlur(0.5, (1.5, 0.5)))
    np.testing.assert_array_equal(found, expected)


def test_without_a_smear_it_is_a_gaussian_and_a_sharp_image_stays_as_it_is():
    layers = RNG.uniform(size=(3, 30, 40))
    soft = ndimage.gaussian_filter(layers, 0.7, mode="constant", axes=(1, 2))
    np.testing.assert_array_equal(ImageBlur(0.7).applied(layers, (1, 2)), soft)
    # A path of less than a tenth of a pixel, or a block, is none.
    np.testing.assert_array_equal(ImageBlur(0.7, (0.05, 0.08)).applied(layers, (1, 2)), soft)
    assert ImageBlur().applied(layers, (1, 2)) is layers
    assert ImageBlur(0.0, (0.3, 0.2)).applied(layers, (1, 2), block=4) is layers


@pytest.mark.parametrize(
    ("psf", "path", "words"),
    [
        (-0.1, (0.0, 0.0), "psf_px: must be 0 to 10 pixels, not -0.1"),
        (float("nan"), (0.0, 0.0), "psf_px"),
        (0.0, (80.0, 80.0), "smear_px: must be a path of 100 pixels at most, not 113.137"),
        (0.0, (float("nan"), 0.0), "smear_px"),
    ],
)
def test_what_no_image_could_have_is_refused(psf, path, words):
    with pytest.raises(SettingsError, match=words):
        ImageBlur(psf, path)


WIDE, NARROW, MOVED = ImageBlur(0.8), ImageBlur(0.3), ImageBlur(0.3, (4.0, 0.0))
BLURS = ImageBlurs((("W*", WIDE), ("N*", NARROW), ("N17", MOVED), ("*[7]*", WIDE)))


def test_a_name_counts_more_than_a_pattern_and_others_have_the_usual_point_spread():
    assert [BLURS.of(name) for name in ("W1", "N1", "N17")] == [WIDE, NARROW, MOVED]
    assert BLURS.of("X7") == ImageBlur()
    assert BLURS.of("X7", 0.4) == ImageBlur(0.4)
    assert BLURS.of("A[7]") == WIDE


def test_two_patterns_that_match_one_image_are_refused():
    with pytest.raises(InvalidValueError, match=r"W\* and \*\[7\]\* both name W\[7\]; add a row"):
        BLURS.of("W[7]")


def test_blurs_of_some_images_have_their_names():
    some = BLURS.among(["N17", "X7", "W1", "N17"])
    assert some == ImageBlurs((("N17", MOVED), ("W1", WIDE)))


def test_rows_in_json_are_read_again():
    rows = BLURS.as_json()
    assert rows[2] == {"image": "N17", "psf_px": 0.3, "smear_px": [4.0, 0.0]}
    assert ImageBlurs.of_json(rows) == BLURS
