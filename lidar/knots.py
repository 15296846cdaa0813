"""Times at which a smooth motion is asked for, so close that straight lines between them are true.

A body-fixed path turns with the body, ends where a kernel ends, and means nothing between returns
that lie hours apart: even steps would have to be as fine everywhere as they must be somewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spcola.arrays import BoolArray, FloatArray

Asked = Callable[[FloatArray], FloatArray]
Departure = Callable[[FloatArray], FloatArray]

EXACT = 5_000
"""Up to so many different times of returns the motion is asked for at each of them."""

# Begun with steps of at most so many seconds, and at least so many of them.
_LONGEST_S, _FEWEST = 60.0, 32
# Steps are not made finer than this, seconds: a path that jumps is straight nowhere.
_LEAST_S = 1e-3


def knots(
    ask: Asked,
    departure: Departure,
    span: tuple[float, float],
    tolerance: float,
    times: FloatArray | None = None,
    edges: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, float]:
    """Find times between which straight lines are good enough, by halving steps where they are not.

    Parameters
    ----------
    ask : callable
        Returns values (N, D) at times (N,), s; NaN where they are not known.
    departure : callable
        Returns how far returns are off, m, where values (N, D) are off by so much.
    span : (float, float)
        First and last time, s.
    tolerance : float
        Largest departure of a straight line that is allowed, m.
    times : (M,) ndarray, optional
        Of the returns, sorted: nothing is looked for between two of them. By default returns may
        be at any time of the span.
    edges : (K,) ndarray, optional
        Times at which values begin or cease to be known.

    Returns
    -------
    time : (N,) ndarray
    value : (N, D) ndarray
        NaN where not known: then nothing is known between that time and the next.
    error : float
        By how much straight lines are off at most, m, estimated.
    """
    if times is not None and len(times) <= EXACT:
        return times, ask(times), 0.0
    begin, end = span
    count = max(_FEWEST, int(np.ceil((end - begin) / _LONGEST_S)))
    time: FloatArray = np.linspace(begin, end, count + 1)
    if edges is not None:
        time = np.union1d(time, edges[(edges > begin) & (edges < end)])
    value = ask(time)
    found = [(time, value)]
    low, high, at_low, at_high = time[:-1], time[1:], value[:-1], value[1:]
    error = 0.0
    while len(low):
        wanted = _holds(times, low, high)
        low, high, at_low, at_high = (one[wanted] for one in (low, high, at_low, at_high))
        middle = (low + high) / 2.0
        value = ask(middle)
        found.append((middle, value))
        # The departure falls fourfold when steps are halved.
        off = departure(value - (at_low + at_high) / 2.0) / 4.0
        finest = high - low <= 2.0 * _LEAST_S
        done = (off <= tolerance) | finest | _none(at_low, value, at_high)
        error = max(error, float(np.fmax.reduce(off[done], initial=0.0)))
        left = ~done
        low, high = np.append(low[left], middle[left]), np.append(middle[left], high[left])
        at_low = np.concatenate([at_low[left], value[left]])
        at_high = np.concatenate([value[left], at_high[left]])
    time = np.concatenate([one for one, _ in found])
    order = np.argsort(time, kind="stable")
    time, value = time[order], np.concatenate([one for _, one in found])[order]
    needed = _holds(times, time[:-1], time[1:])
    kept = np.append(needed, False) | np.append(False, needed)
    return time[kept], value[kept], error


def _holds(times: FloatArray | None, low: FloatArray, high: FloatArray) -> BoolArray:
    """Whether there are returns between two times, those at them included."""
    if times is None:
        return np.ones(len(low), dtype=bool)
    held: BoolArray = np.searchsorted(times, high, "right") > np.searchsorted(times, low)
    return held


def _none(*values: FloatArray) -> BoolArray:
    """Whether nothing is known at the ends of a step and in its middle."""
    none: BoolArray = np.all([~np.isfinite(value).all(axis=1) for value in values], axis=0)
    return none
