"""Medians by counting against those by sorting."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.medians import median_of


@pytest.mark.parametrize("size", [1, 2, 3, 4, 15, 16, 17, 18, 100, 101, 5000])
@pytest.mark.parametrize("kind", ["random", "sorted", "reversed", "equal", "few", "organ"])
def test_the_median_of_any_order(size: int, kind: str) -> None:
    rng = np.random.default_rng(size)
    values = {
        "random": rng.normal(size=size),
        "sorted": np.arange(size, dtype=float),
        "reversed": np.arange(size, dtype=float)[::-1].copy(),
        "equal": np.full(size, 2.5),
        "few": rng.integers(0, 3, size).astype(float),
        "organ": np.concatenate([np.arange(size // 2), np.arange(size - size // 2)[::-1]]) * 1.0,
    }[kind]
    given = np.concatenate([values, [1e9]])
    assert median_of(given, size) == np.median(values)
    np.testing.assert_array_equal(given[:size], values)
