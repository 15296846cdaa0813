from __future__ import annotations

import numpy as np
import pytest

from spcola.errors import NotObservableError
from spcola.math.statistics import SizeLikelihood, most_likely_sizes


def of_two_samples(squares, counts):
    """Likelihood of the standard deviations of two independent normal samples of mean 0."""

    def likelihood(sizes):
        ratio = squares / sizes**2
        return SizeLikelihood(
            float(np.sum(2.0 * counts * np.log(sizes) + ratio)),
            2.0 * (counts - ratio),
            np.diag(4.0 * ratio),
        )

    return likelihood


@pytest.mark.parametrize("start", [1e-3, 0.2, 1.0, 50.0])
def test_the_standard_deviation_of_a_sample_is_found_from_any_start(start):
    squares, counts = np.array([40.0, 0.9]), np.array([10.0, 90.0])
    found = most_likely_sizes(
        of_two_samples(squares, counts),
        np.array([2.0, 0.1]),
        width=1e6,
        start=np.array([2.0, 0.1]) * start,
    )
    np.testing.assert_allclose(found, np.sqrt(squares / counts), rtol=1e-4)


def test_a_size_without_data_is_the_median_of_its_prior():
    found = most_likely_sizes(
        of_two_samples(np.zeros(2), np.zeros(2)),
        np.array([3.0, 0.5]),
        width=np.array([1.0, 2.0]),
        start=np.array([0.1, 4.0]),
    )
    np.testing.assert_allclose(found, [3.0, 0.5], rtol=1e-3)


def test_an_error_that_the_data_exclude_becomes_small_and_not_less_than_its_bound():
    found = most_likely_sizes(
        of_two_samples(np.zeros(2), np.array([0.0, 1e6])),
        np.ones(2),
        width=1e3,
        start=np.ones(2),
    )
    assert found[1] == pytest.approx(np.exp(-10.0))


def test_a_search_that_crawls_is_not_a_result():
    def steady(sizes):
        # The deviance falls evenly by the logarithm, and the steps are of a fiftieth.
        return SizeLikelihood(-float(np.log(sizes[0])), np.array([-1.0]), np.array([[50.0]]))

    with pytest.raises(NotObservableError, match="still change by 2% after 200 steps"):
        most_likely_sizes(steady, np.ones(1), width=1e9, start=np.full(1, np.exp(-9.0)))
