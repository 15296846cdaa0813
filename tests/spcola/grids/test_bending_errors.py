from __future__ import annotations

import numpy as np
import pytest

from spcola.grids.bending import (
    BENDING_NOISE,
    BENDING_RANGE_NOISE,
    CELL_SHARE,
    bending,
    bending_around,
    bending_range,
)

Y, X = np.mgrid[-10:11, -10:11].astype(float)


def test_bending_of_a_quadric_is_exact_and_planes_have_none():
    quadric = 0.3 * X**2 - 0.1 * Y**2 + 0.2 * X * Y + 4.0 * X - Y + 7.0
    inner = bending(quadric)[1:-1, 1:-1]
    np.testing.assert_allclose(inner, 2.0 * (0.3 - 0.1), atol=1e-12)
    np.testing.assert_allclose(bending_range(quadric), 0.0, atol=1e-12)
    assert np.isnan(bending(quadric)[0]).all()


def test_bending_around_points_is_known_to_the_border():
    quadric = 0.3 * X**2 - 0.1 * Y**2 + 4.0 * X + 7.0
    np.testing.assert_allclose(bending_around(quadric)[3:-3, 3:-3], 0.4, atol=1e-12)
    np.testing.assert_allclose(bending_around(4.0 * X - Y), 0.0, atol=1e-12)
    one = np.zeros((9, 9))
    one[4, 4] = 3.0
    # Of the 3 x 3 points around, -4 in the middle, -1 at the sides, 2 at the corners.
    assert bending_around(one)[4, 4] == pytest.approx(np.sqrt((16 + 4 * 1 + 4 * 4) / 9))


def test_a_gap_makes_the_points_next_to_it_unknown():
    height = X**2
    height[10, 10] = np.nan
    unknown = np.isnan(bending(height)[1:-1, 1:-1])
    assert unknown.sum() == 9
    assert (bending_range(height) == 0.0).all()


def test_the_mean_over_a_cell_exceeds_the_middle_by_its_share():
    fine = (np.arange(200) + 0.5) / 200.0 - 0.5
    x, y = np.meshgrid(fine, fine)
    h_xx, h_yy, h_xy = 0.7, -0.3, 0.4
    mean = np.mean(0.5 * (h_xx * x**2 + h_yy * y**2) + h_xy * x * y)
    assert mean == pytest.approx(CELL_SHARE * (h_xx + h_yy), rel=1e-4)


def test_what_noise_makes_of_both():
    noise = np.random.default_rng(1).normal(size=(1000, 1000))
    assert np.nanvar(bending(noise)) == pytest.approx(BENDING_NOISE, rel=0.01)
    inner = bending_range(noise)[2:-2, 2:-2]
    assert np.mean(inner**2) == pytest.approx(BENDING_RANGE_NOISE, rel=0.01)
