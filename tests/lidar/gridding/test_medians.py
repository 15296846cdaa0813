"""Medians by counting against those by sorting."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.gridding.cells.medians import column_medians, median_of, middle_network


@pytest.mark.parametrize("size", [1, 2, 3, 4, 15, 16, 17, 18, 100, 101, 5000])
def test_the_median_of_any_order(size: int) -> None:
    rng = np.random.default_rng(size)
    for values in (
        rng.normal(size=size),
        np.arange(size, dtype=float),
        np.arange(size, dtype=float)[::-1].copy(),
        np.full(size, 2.5),
        rng.integers(0, 3, size).astype(float),
        np.concatenate([np.arange(size // 2), np.arange(size - size // 2)[::-1]]) * 1.0,
    ):
        given = np.concatenate([values, [1e9]])
        assert median_of(given, size) == np.median(values)
        np.testing.assert_array_equal(given[:size], values)


@pytest.mark.parametrize("size", [2, 4, 6, 10, 18, 24, 40])
def test_a_network_finds_the_middle_of_columns(size: int) -> None:
    rng = np.random.default_rng(size)
    values = np.concatenate([rng.normal(size=(size, 300)), rng.integers(0, 3, (size, 100))], axis=1)
    found = np.empty(400)
    column_medians(values.copy(), middle_network(size), found)
    np.testing.assert_array_equal(found, np.median(values, axis=0))


@pytest.mark.parametrize("size", [2, 4, 6, 10])
def test_a_network_brings_the_middle_there_for_every_order(size: int) -> None:
    """A network that does it for all zeros and ones does it for all values (Knuth 5.3.4 Z)."""
    values = (np.arange(2**size)[None] >> np.arange(size)[:, None] & 1).astype(float)
    found = np.empty(2**size)
    column_medians(values.copy(), middle_network(size), found)
    np.testing.assert_array_equal(found, np.median(values, axis=0))
