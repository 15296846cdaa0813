"""Scale and weights of pixels: planted values, outliers, correlated neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from spcola.math.robust import MAD_TO_SIGMA, mad
from spcola.photometry.photoclinometry.pixel_weights import (
    expect_pixels,
    find_inner,
    fit_scale,
    median_deviation,
    weigh_pixels,
)

SHAPE = (60, 80)
SCALE, SPREAD, LOSS = 40.0, 0.02, 3.0


@pytest.fixture
def rng():
    return np.random.default_rng(8)


def weighed(pixels, expected, *, edge=None, area=None, dark=0.0):
    """The five layers, and which pixels have them."""
    edge = np.zeros(SHAPE) if edge is None else edge
    area = np.ones(SHAPE) if area is None else area
    used, out = np.zeros(SHAPE, dtype=bool), np.full((*SHAPE, 5), np.nan)
    count = find_inner(expected, np.isfinite(expected), used)
    assert count == np.count_nonzero(used)
    weigh_pixels(pixels, used, (expected, area, edge), (SCALE, SPREAD, dark, LOSS, 1), out)
    assert not out[~used].any()
    return out, used


def test_pixels_without_enough_ground_are_unknown():
    sums = np.array([[[0.5, 0.8, 0.8, 1.0]], [[0.5, 0.4, 0.4, 0.0]], [[0.0, 0.2, 0.0, 0.0]]])
    used = np.zeros((1, 4), dtype=bool)
    expect_pixels(sums, np.array([[True, True, False, True]]), 0.6, used)
    np.testing.assert_array_equal(used, [[False, True, False, False]])
    np.testing.assert_allclose(sums[1:], [[[np.nan, 0.5, 0.5, 0]], [[np.nan, 0.25, 0, 0]]])


def test_a_pixel_next_to_unknown_ground_has_no_gradient_and_does_not_count(rng):
    expected = rng.uniform(0.5, 1.0, SHAPE)
    expected[20, 30] = np.nan
    _, used = weighed(SCALE * expected, expected)
    missing = {(20, 30), (19, 30), (21, 30), (20, 29), (20, 31)}
    assert {tuple(one) for one in np.argwhere(~used[1:-1, 1:-1]) + 1} == missing
    assert not used[[0, -1]].any()
    assert not used[:, [0, -1]].any()


def test_scale_is_found_next_to_outliers(rng):
    expected = rng.uniform(0.2, 1.0, 4000)
    pixels = SCALE * expected * (1.0 + SPREAD * rng.normal(size=4000))
    pixels[::20] *= 3.0
    scale = SCALE * 1.1
    for _ in range(20):
        scale = fit_scale(pixels, expected, scale, scale * SPREAD * LOSS)
    assert scale == pytest.approx(SCALE, rel=4 * SPREAD / np.sqrt(4000))


def test_scale_is_that_of_least_squares_without_outliers(rng):
    expected = rng.uniform(0.2, 1.0, 500)
    pixels = SCALE * expected * (1.0 + SPREAD * rng.normal(size=500))
    assert fit_scale(pixels, expected, SCALE, 1e9) == pytest.approx(
        (pixels @ expected) / (expected @ expected), rel=1e-12
    )


@pytest.mark.parametrize("size", [1, 2, 3, 8, 101, 4000])
def test_median_deviation_is_that_of_sorted_numbers(rng, size):
    for values in (
        rng.normal(size=size),
        rng.integers(0, 4, size).astype(float),
        np.ones(size),
        np.arange(size, 0.0, -1.0),
    ):
        before = values.copy()
        assert MAD_TO_SIGMA * median_deviation(values) == mad(values)
        np.testing.assert_array_equal(values, before)
    assert np.isnan(median_deviation(np.full(size, np.nan)))


def test_layers_are_weighted_residual_brightness_and_gradient(rng):
    y, x = np.indices(SHAPE)
    expected = 0.5 + 0.004 * x - 0.003 * y
    pixels = SCALE * expected * (1.0 + SPREAD * rng.normal(size=SHAPE))
    edge, area = np.full(SHAPE, 0.5), np.full(SHAPE, 0.8)
    out, used = weighed(pixels, expected, edge=edge, area=area)
    score = (pixels / (SCALE * expected) - 1.0) / SPREAD
    weight = 0.25 / 0.8 / (1.0 + (score / LOSS) ** 2) / (SPREAD * SCALE * expected) ** 2
    # White noise: neighbours are not correlated, beyond chance.
    common = (weight / np.where(used, out[..., 0], np.nan))[used]
    assert np.ptp(common) < 1e-9
    assert 1.0 <= common[0] < 1.15
    for layer, value in enumerate(
        (pixels - SCALE * expected, SCALE * expected, SCALE * 0.004, -SCALE * 0.003), start=1
    ):
        quotient = (out[..., layer] / np.where(used, out[..., 0], np.nan))[used]
        np.testing.assert_allclose(quotient, np.broadcast_to(value, SHAPE)[used], rtol=1e-9)


def test_errors_that_neighbours_share_count_once(rng):
    """Blocks of 3 × 3 pixels with one error each."""
    blocks = np.kron(rng.normal(size=(20, 27)), np.ones((3, 3)))[: SHAPE[0], : SHAPE[1]]
    expected = np.ones(SHAPE)
    alone, used = weighed(SCALE * (1.0 + 0.1 * SPREAD * rng.normal(size=SHAPE)), expected)
    shared, _ = weighed(SCALE * (1.0 + 0.1 * SPREAD * blocks), expected)
    ratio = np.median(alone[used, 0]) / np.median(shared[used, 0])
    # One plus the mean share of the eight neighbours that lie in the same block.
    assert ratio == pytest.approx(1.0 + 4 * 2 / 3 + 4 * 4 / 9, rel=0.15)


def test_the_error_of_a_dark_pixel_falls_no_further():
    expected = np.where(np.arange(SHAPE[1]) < 40, 0.01, 1.0) * np.ones(SHAPE)
    out, used = weighed(SCALE * expected, expected, dark=0.3)
    assert out[30, 20, 0] == pytest.approx((SPREAD * SCALE * 0.3) ** -2)
    assert out[30, 60, 0] == pytest.approx((SPREAD * SCALE) ** -2)
    assert used[30, [20, 60]].all()
