"""Times in tables: fast where that is exact, SPICE's everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from lidar.formats.records.times import is_time, times_of
from spcola.navigation import et_from_utcs


@pytest.mark.parametrize(
    ("start", "step_s"),
    [
        ("2018-07-01T22:50:11.217091", 0.7),
        ("2018-07-01T22:50:11.217091", 300.0),
        ("2016-12-31T23:58:00.000000", 0.9),  # a leap second on the way
        ("2005-03-01T00:00:00.000000", 86400.0),
    ],
)
def test_many_times_are_those_of_spice(start: str, step_s: float) -> None:
    steps = (np.arange(400) * step_s * 1e6).astype("timedelta64[us]")
    order = np.random.default_rng(1).permutation(400)
    texts = np.datetime_as_string((np.datetime64(start, "us") + steps)[order]).tolist()
    np.testing.assert_allclose(times_of(texts), et_from_utcs(texts), rtol=0, atol=1e-6)


def test_bad_times_among_many_are_nan() -> None:
    texts = [f"2018-07-01T22:{i // 60:02d}:{i % 60:02d}Z" for i in range(200)]
    good = times_of(texts)
    texts[3], texts[50], texts[60] = "2018-13-01T22:00:00", "noon", "9018-07-01T22:00:00"
    times = times_of(texts)
    assert np.flatnonzero(np.isnan(times)).tolist() == [3, 50, 60]
    kept = np.isfinite(times)
    np.testing.assert_allclose(times[kept], good[kept], rtol=0, atol=1e-6)


def test_forms_of_times() -> None:
    assert is_time("2018-07-01T22:50:11.217091")
    assert is_time("2018-182T22:50:11Z")
    assert not is_time("2018-07-01")
    assert not is_time("20180701")
    assert not is_time("1.5")
    np.testing.assert_allclose(
        times_of(["2018-182T22:50:11"] * 150), et_from_utcs(["2018-07-01T22:50:11"])[0]
    )
    assert len(times_of([])) == 0
