"""Bit depth and thresholds: defined numbers for every pixel, planted thresholds found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spcola.camera.detector import (
    BitDepth,
    PixelValues,
    Preparation,
    prepare_pixels,
)
from spcola.camera.detector.bit_depth import scaling_for, to_unsigned
from spcola.camera.detector.thresholds import bright_threshold, shadow_threshold
from spcola.errors import InvalidValueError, NotObservableError

RNG = np.random.default_rng(11)


def pixels_of(values, missing=(), dark=(), saturated=()):
    masks = []
    for places in (missing, dark, saturated):
        mask = np.zeros(values.shape, dtype=bool)
        for place in places:
            mask[place] = True
        masks.append(mask)
    return PixelValues(values, *masks)


def stored_of(values, bits=16):
    return to_unsigned(pixels_of(np.clip(np.rint(values), 0, None)), BitDepth(bits))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int16, np.int32])
def test_integers_that_fit_are_kept_to_the_bit(kind) -> None:
    top = 255 if kind is np.uint8 else 4095
    values = RNG.integers(0, top + 1, (30, 40)).astype(kind)
    stored = prepare_pixels(pixels_of(values), Preparation()).stored
    np.testing.assert_array_equal(stored.dn, values)
    assert stored.dn.dtype == (np.uint8 if kind is np.uint8 else np.uint16)
    assert (stored.depth.gain, stored.depth.offset) == (1.0, 0.0)
    assert not np.shares_memory(stored.dn, values)


def test_special_pixels_have_defined_numbers() -> None:
    values = np.full((4, 4), 100.0, dtype=np.float32)
    values[0, 0] = np.nan
    found = to_unsigned(
        pixels_of(values, missing=[(0, 0)], dark=[(1, 1)], saturated=[(2, 2)]), BitDepth(8)
    )
    assert [int(found.dn[k, k]) for k in range(4)] == [0, 0, 255, 100]
    assert (found.missing, found.saturated, found.below, found.above) == (1, 1, 0, 0)


def test_what_exceeds_the_range_is_cut_and_counted() -> None:
    found = to_unsigned(pixels_of(np.array([[-3.0, 0.4, 300.0, 99.6]])), BitDepth(8))
    assert found.dn.tolist() == [[0, 0, 255, 100]]
    assert (found.below, found.above) == (1, 1)


@given(st.floats(1e-9, 1e9), st.integers(0, 2**31))
def test_ratios_are_kept_whatever_the_unit(unit, seed) -> None:
    values = unit * np.random.default_rng(seed).uniform(0.01, 1.0, (8, 8))
    depth = scaling_for(pixels_of(values))
    dn = to_unsigned(pixels_of(values), depth).dn.astype(float)
    assert dn.max() == 65534
    np.testing.assert_allclose(dn / 65534, values / values.max(), atol=0.5001 / 65534)


def test_a_hot_pixel_does_not_cost_resolution() -> None:
    values = RNG.uniform(0.0, 1.0, (100, 100))
    values[5, 5] = 1e6
    stored = to_unsigned(pixels_of(values), scaling_for(pixels_of(values)))
    assert stored.above == 1
    assert stored.dn[5, 5] == 65535
    assert np.median(stored.dn) > 5000


def test_images_without_brightness_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="no positive pixel"):
        scaling_for(pixels_of(np.zeros((3, 3))))
    with pytest.raises(InvalidValueError, match="no valid pixel"):
        scaling_for(pixels_of(np.ones((1, 1)), missing=[(0, 0)]))
    with pytest.raises(InvalidValueError, match="SPC has 8 or 16"):
        BitDepth(12)  # type: ignore[arg-type]


def body_and_sky(sky, noise, gain=1.0):
    values = RNG.normal(sky, noise, (256, 256))
    line, sample = np.indices(values.shape)
    disc = (line - 128) ** 2 + (sample - 110) ** 2 < 80**2
    values[disc] = np.linspace(60, 220, np.count_nonzero(disc))
    return gain * values


@pytest.mark.parametrize("gain", [1.0, 10.0, 200.0])
def test_the_shadow_threshold_lies_five_sigma_above_the_sky(gain) -> None:
    found = shadow_threshold(stored_of(body_and_sky(20.0, 2.0, gain)))
    assert found == pytest.approx(30.0 * gain, abs=2.5 * gain)


def test_a_sky_of_zeros_gives_the_smallest_threshold() -> None:
    values = body_and_sky(0.0, 0.0)
    assert shadow_threshold(stored_of(values, 8)) <= 4


def test_ground_that_fills_the_frame_is_not_cut() -> None:
    ground = RNG.uniform(40, 200, (200, 200))
    assert shadow_threshold(stored_of(ground)) == 4
    sloping = np.linspace(10, 210, 40000).reshape(200, 200)
    assert shadow_threshold(stored_of(sloping)) <= 6


def test_dark_slopes_of_a_lit_frame_are_not_cut() -> None:
    # 0.4 % of the ground is darker than a quarter of its brightest part, without a peak.
    ground = RNG.normal(26000, 6000, (400, 400))
    assert np.mean(ground < 0.25 * np.percentile(ground, 99)) > 0.001
    assert shadow_threshold(stored_of(ground)) < 1000


def test_a_bright_background_is_separated_from_the_body() -> None:
    values = body_and_sky(20.0, 2.0, gain=4.0)
    values[:, 200:] = RNG.normal(3000, 40, (256, 56))
    stored = stored_of(values)
    low = shadow_threshold(stored)
    high = bright_threshold(stored, low)
    assert 4 * 220 <= high <= 3000 - 3 * 40
    preparation = Preparation(depth=BitDepth(16), bright_background=True)
    assert prepare_pixels(pixels_of(np.rint(values)), preparation).thresholds == (low, high)


def test_no_bright_background_is_reported() -> None:
    with pytest.raises(NotObservableError, match="give the upper threshold"):
        bright_threshold(stored_of(RNG.normal(100, 10, (200, 200))), 5)


def test_thresholds_given_or_found() -> None:
    values = body_and_sky(20.0, 2.0)
    plain = prepare_pixels(pixels_of(values.astype(np.uint16)), Preparation())
    assert plain.thresholds[1] == 65535
    bright = prepare_pixels(
        pixels_of(values.astype(np.uint16), saturated=[(0, 0)]), Preparation(low=7)
    )
    assert bright.thresholds == (7, 65534)
    with pytest.raises(InvalidValueError, match="thresholds: are 9 and 3"):
        prepare_pixels(pixels_of(values.astype(np.uint16)), Preparation(low=9, high=3))
