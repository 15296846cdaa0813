"""Times as lidar tables write them: UTC in ISO form, beside ephemeris time or alone."""

from __future__ import annotations

import re

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import FormatError
from spcola.time import et_from_utc, et_from_utcs

_TIME = re.compile(r"\d{4}-(\d{2}-\d{2}|\d{3})T\d{2}:\d{2}:\d{2}(\.\d*)?Z?")
# UTC may be rounded to a second; the ephemeris time is what is used.
_SAME_TIME_S = 1.5


def is_time(text: str) -> bool:
    """Tell whether a text is a UTC in ISO form (calendar or day of year)."""
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
        return et_from_utcs(texts)
    except FormatError:
        # One is no time after all (month 13): take them singly to find out which.
        return np.array([_time_or_nan(text) for text in texts])


def _time_or_nan(text: str) -> float:
    try:
        return et_from_utc(text)
    except FormatError:
        return float("nan")


def times_differ(et: FloatArray, utcs: list[str]) -> BoolArray:
    """Tell where ephemeris times (N,), s, and UTC texts say different things."""
    differ: BoolArray = ~(np.abs(et - times_of(utcs)) <= _SAME_TIME_S)
    return differ
