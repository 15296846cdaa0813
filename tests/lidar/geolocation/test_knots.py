"""Times between which straight lines are true: as many as it takes, and where returns are."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.geolocation import Geolocation
from lidar.geolocation.knots import EXACT, knots

DAYS = 5.8 * 86400.0
TOLERANCE = 5e-4


def circle(time: np.ndarray) -> np.ndarray:
    """A station 5 km away, body-fixed: around in 4.3 hours."""
    angle = 2 * np.pi * time / (4.3 * 3600.0)
    return 5000.0 * np.column_stack([np.cos(angle), np.sin(angle)])


def size(off: np.ndarray) -> np.ndarray:
    return np.linalg.norm(off, axis=1)


def lines(time: np.ndarray, value: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(wanted, time, column) for column in value.T])


def test_five_days_are_as_good_as_five_minutes() -> None:
    time, value, error = knots(circle, size, (0.0, DAYS), TOLERANCE)
    wanted = np.linspace(0.0, DAYS, 100_003)
    off = size(lines(time, value, wanted) - circle(wanted)).max()
    assert off <= error <= TOLERANCE
    assert len(time) > 8193


def test_a_few_returns_are_asked_for_each() -> None:
    times = np.sort(np.random.default_rng(1).uniform(0.0, DAYS, EXACT))
    time, value, error = knots(circle, size, (0.0, DAYS), TOLERANCE, times)
    np.testing.assert_array_equal(time, times)
    np.testing.assert_array_equal(value, circle(times))
    assert error == 0.0


def test_nothing_is_asked_where_no_returns_are() -> None:
    """Between two arcs a path through their returns means nothing, and is nowhere smooth."""
    rng = np.random.default_rng(2)
    times = np.sort(np.append(rng.uniform(0, 300, 4000), DAYS - rng.uniform(0, 300, 4000)))
    asked = []

    def wild(time: np.ndarray) -> np.ndarray:
        asked.append(len(time))
        between = (time > 400.0) & (time < DAYS - 400.0)
        return np.where(between[:, None], 1e6 * np.sin(time**2)[:, None], circle(time))

    time, value, error = knots(wild, size, (0.0, DAYS), TOLERANCE, times)
    assert sum(asked) < 2_000
    assert np.isin(time, times).all()
    off = size(lines(time, value, times) - circle(times)).max()
    assert off <= error <= TOLERANCE


@pytest.mark.parametrize("edge", [1234.5, 3600.0])
def test_what_ends_is_known_to_its_end_and_no_further(edge: float) -> None:
    def ends(time: np.ndarray) -> np.ndarray:
        return np.where((time <= edge)[:, None], circle(time), np.nan)

    for edges in (None, np.array([edge])):
        time, value, error = knots(ends, size, (0.0, 7200.0), TOLERANCE, None, edges)
        known = time[np.isfinite(value).all(axis=1)]
        assert edge - 2e-3 <= known.max() <= edge
        assert time[np.isnan(value).any(axis=1)].min() <= edge + 2e-3
        assert error <= TOLERANCE


def test_what_is_known_for_seconds_is_found_among_returns() -> None:
    """Three images alone, and a gap of two seconds, among returns of every tenth of a second."""
    times = 0.1 * np.arange(20_000)
    windows = np.array([[503.0, 507.0], [801.0, 801.0], [1000.0, 1203.0], [1205.0, 1500.0]])

    def islands(time: np.ndarray) -> np.ndarray:
        known = ((time[:, None] >= windows[:, 0]) & (time[:, None] <= windows[:, 1])).any(axis=1)
        return np.where(known[:, None], circle(time), np.nan)

    time, value, _ = knots(islands, size, (0.0, 2000.0), TOLERANCE, times, np.unique(windows))
    move = Geolocation(shift_time=time, shift=np.column_stack([value, 0 * time]), moves=True)
    found = move.covers(times)
    np.testing.assert_array_equal(found, np.isfinite(islands(times)).all(axis=1))


def test_a_path_that_jumps_does_not_go_on_forever() -> None:
    def jumps(time: np.ndarray) -> np.ndarray:
        return circle(time) + np.where(time > 1000.0, 3.0, 0.0)[:, None]

    time, value, error = knots(jumps, size, (0.0, 3600.0), TOLERANCE)
    assert len(time) < 10_000
    assert np.diff(time).min() >= 5e-4
    # It is stated: a return within a millisecond of the jump may be off by a part of it.
    assert error > 0.1
    wanted = np.array([999.9, 1000.1])
    np.testing.assert_allclose(lines(time, value, wanted), jumps(wanted), atol=TOLERANCE)
