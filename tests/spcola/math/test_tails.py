"""Tails of distributions are those of ``scipy.stats``."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from spcola.math.statistics import chi_square_tail


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_chi_square(count: int) -> None:
    values = (-1.0, 0.0, 0.3, 5.0, 80.0, np.inf, np.nan)
    found = [chi_square_tail(value, count) for value in values]
    np.testing.assert_array_equal(found, stats.chi2.sf(values, count))
