from __future__ import annotations

import numpy as np
import pytest

from spcola.grids.robust_covariance import biweight_scores, huber_scores
from spcola.math.robust import HUBER, biweight, cauchy_weight, huber_weight, mad


def test_mad_is_the_standard_deviation_of_a_normal_sample() -> None:
    sample = np.random.default_rng(1).normal(5.0, 2.0, 200_001)
    assert float(mad(sample)) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("axis", [None, 0, 1])
def test_mad_equals_nanmedian_formula(axis: int | None) -> None:
    values = np.random.default_rng(2).normal(size=(40, 31))
    values[values > 1.2] = np.nan
    center = np.nanmedian(values, axis=axis, keepdims=True)
    expected = 1.482602218505602 * np.nanmedian(np.abs(values - center), axis=axis)
    np.testing.assert_allclose(mad(values, axis=axis), expected, rtol=1e-14)


def test_mad_of_nothing_is_nan_without_warning() -> None:
    assert np.isnan(mad([]))
    assert np.isnan(mad([np.nan, np.nan]))
    assert mad(np.empty((3, 0)), axis=1).shape == (3,)
    np.testing.assert_array_equal(mad([[1.0, 2.0, 3.0], [np.nan] * 3], axis=1)[1:], [np.nan])


def test_mad_resists_a_third_of_outliers() -> None:
    sample = np.random.default_rng(3).normal(size=9001)
    sample[::3] = 1e6
    assert float(mad(sample)) < 2.6


def test_huber_weights() -> None:
    z = np.array([0.0, -1.0, 1.345, 2.69, -13.45, np.nan])
    np.testing.assert_allclose(huber_weight(z), [1.0, 1.0, 1.0, 0.5, 0.1, 0.0])


def test_biweight_lets_go_of_what_is_far() -> None:
    weights = biweight([0.0, 4.685 / np.sqrt(2.0), -4.685, 100.0, np.nan])
    np.testing.assert_allclose(weights, [1.0, 0.25, 0.0, 0.0, 0.0], atol=1e-15)


def test_cauchy_weights() -> None:
    z = np.array([0.0, 2.385, -2.385, np.inf, np.nan])
    np.testing.assert_allclose(cauchy_weight(z), [1.0, 0.5, 0.5, 0.0, 0.0])


@pytest.mark.parametrize("scores", [huber_scores, biweight_scores])
def test_scores_are_residuals_by_their_weights_and_change_as_stated(scores):
    residual = np.linspace(-3.0, 3.0, 601)
    found = scores(residual, 0.4)
    weight = huber_weight if scores is huber_scores else biweight
    np.testing.assert_allclose(found.pull, residual * weight(residual / 0.4), atol=1e-12)
    slope = np.gradient(found.pull, residual)
    smooth = np.abs(np.abs(residual) - HUBER * 0.4) > 0.02
    np.testing.assert_allclose(found.slope[smooth], slope[smooth], atol=5e-3)
    alone = scores(np.array([1.0, np.nan]), 0.0)
    assert alone.pull[0] == 1.0
    assert np.isnan(alone.pull[1])
