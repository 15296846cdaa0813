"""Times of lidar tables: UTC in ISO form, next to ephemeris time or alone."""

from __future__ import annotations

import re

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import FormatError
from spcola.navigation import et_from_utc, et_from_utcs

_TIME = re.compile(r"(19|20|21)\d\d-(\d{2}-\d{2}|\d{3})T\d{2}:\d{2}:\d{2}(\.\d*)?Z?")
# UTC may be rounded to a second; the ephemeris time is what is used.
_SAME_TIME_S = 1.5
# TDB less terrestrial time, at most, and what rounding adds.
_MOST_TDB_S = 2e-3
_MICROSECONDS = re.compile(r"\.\d{6,}Z?$")
_FEW = 100
_EVEN_SPAN_S = 2 * 86400.0
_LEAP_S = 0.5


def is_time(text: str) -> bool:
    """Return whether a text is a UTC in ISO form (calendar or day of year)."""
    return _TIME.fullmatch(text) is not None


def times_of(texts: list[str]) -> FloatArray:
    """Ephemeris times (N,), s, of UTC texts in ISO form; NaN where one is not a time."""
    known = [is_time(text) for text in texts]
    times = np.full(len(texts), np.nan)
    good = [text.rstrip("Z") for text, ok in zip(texts, known, strict=True) if ok]
    times[np.array(known, dtype=bool)] = _converted(good)
    return times


def _converted(texts: list[str]) -> FloatArray:
    try:
        times = _interpolated(texts)
        return et_from_utcs(texts) if times is None else times
    except FormatError:
        # One of them is invalid (month 13): convert them singly to find out which.
        return np.array([_time_or_nan(text) for text in texts])


def _interpolated(texts: list[str]) -> FloatArray | None:
    """Interpolate times (N,) from the first and last, since SPICE takes 20 µs for each.

    None if that is not exact: a leap second between them, a span over which the difference of
    TDB and UTC varies by a microsecond, or a form that only SPICE reads.
    """
    if len(texts) < _FEW:
        return None
    try:
        clock = np.array(texts, dtype="datetime64[ns]")
    except ValueError:
        return None
    first, last = int(np.argmin(clock)), int(np.argmax(clock))
    elapsed: FloatArray = (clock - clock[first]) / np.timedelta64(1, "s")
    begin, end = et_from_utcs([texts[first], texts[last]])
    drift = (end - begin) - elapsed[last]
    if elapsed[last] > _EVEN_SPAN_S or abs(drift) > _LEAP_S:
        return None
    share = elapsed / elapsed[last] if elapsed[last] > 0 else np.zeros(len(texts))
    return begin + elapsed + drift * share


def _time_or_nan(text: str) -> float:
    try:
        return et_from_utc(text)
    except FormatError:
        return float("nan")


def dynamical_times(et: FloatArray, utcs: list[str]) -> FloatArray:
    """Return ephemeris times (N,), s, from UTC texts that have microseconds; else those given.

    Tables give terrestrial time (UTC and leap seconds alone) as ephemeris time: TDB differs by up
    to 1.7 ms over the year, in which an orbiter of the Moon moves by 2.7 m.
    """
    precise = np.array([_MICROSECONDS.search(text) is not None for text in utcs], dtype=np.bool_)
    times = times_of(utcs)
    return np.where(precise & (np.abs(times - et) < _MOST_TDB_S), times, et)


def times_differ(et: FloatArray, utcs: list[str]) -> BoolArray:
    """Return where ephemeris times (N,), s, and UTC texts disagree."""
    differ: BoolArray = ~(np.abs(et - times_of(utcs)) <= _SAME_TIME_S)
    return differ
