"""Times at which a smooth motion is sampled, dense enough for linear interpolation.

A body-fixed path turns with the body, ends where a kernel ends, and is not needed between returns
that lie hours apart: uniform steps would have to be the finest everywhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spcola.arrays import BoolArray, FloatArray

Sampler = Callable[[FloatArray], FloatArray]
Departure = Callable[[FloatArray], FloatArray]

EXACT = 5_000
"""With at most so many different times of returns the motion is sampled at each of them."""

# First steps: at most so many seconds long, and at least so many of them.
_LONGEST_S, _FEWEST = 60.0, 32
# Shortest step, seconds: a path that jumps is linear nowhere.
_LEAST_S = 1e-3
# Largest error of linear interpolation, relative to that in the middle of a step.
_CORNER = 2.0


def knots(
    sample: Sampler,
    departure: Departure,
    span: tuple[float, float],
    tolerance: float,
    times: FloatArray | None = None,
    edges: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, float]:
    """Find times between which linear interpolation is good enough, by halving steps.

    Parameters
    ----------
    sample : callable
        Returns values (N, D) at times (N,), s; NaN where they are not known.
    departure : callable
        Returns the displacement of returns (N,), m, due to errors of the values (N, D).
    span : (float, float)
        First and last time, s.
    tolerance : float
        Largest error of linear interpolation, m.
    times : (M,) ndarray, optional
        Times of the returns, sorted: the motion is sampled at these only. By default returns may be
        at any time of the span.
    edges : (E,) ndarray, optional
        Times at which values begin or cease to be known, s.

    Returns
    -------
    time : (N,) ndarray
    value : (N, D) ndarray
        NaN where unknown: then nothing is known between that time and the next.
    error : float
        Estimated largest error of linear interpolation, m.
    """
    if times is not None and len(times) <= EXACT:
        return times, sample(times), 0.0
    time = _start(span, times, edges)
    value = sample(time)
    found = [(time, value)]
    low, high, at_low, at_high = time[:-1], time[1:], value[:-1], value[1:]
    error = 0.0
    while len(low):
        middle = _middle(low, high, times)
        split = (middle > low) & (middle < high)
        low, high, middle = low[split], high[split], middle[split]
        at_low, at_high, value = at_low[split], at_high[split], sample(middle)
        found.append((middle, value))
        share = ((middle - low) / (high - low))[:, None]
        off = departure(value - at_low - share * (at_high - at_low))
        # The error of a smooth path falls to a quarter of this once the step is halved, that of one
        # with a corner near an end to a half.
        off *= _CORNER
        done = (off <= tolerance) | (high - low <= 2.0 * _LEAST_S) | _none(at_low, value, at_high)
        error = max(error, float(np.fmax.reduce(off[done], initial=0.0)))
        left = ~done
        low, high = np.append(low[left], middle[left]), np.append(middle[left], high[left])
        at_low = np.concatenate([at_low[left], value[left]])
        at_high = np.concatenate([value[left], at_high[left]])
    time, order = np.unique(np.concatenate([one for one, _ in found]), return_index=True)
    return time, np.concatenate([one for _, one in found])[order], error


def _start(
    span: tuple[float, float], times: FloatArray | None, edges: FloatArray | None
) -> FloatArray:
    """First times, those of returns if they are given: steps that are not too long."""
    begin, end = span
    count = max(_FEWEST, int(np.ceil((end - begin) / _LONGEST_S)))
    even: FloatArray = np.linspace(begin, end, count + 1)
    if edges is not None:
        even = np.union1d(even, edges[(edges > begin) & (edges < end)])
    if times is None:
        return even
    # The returns on both sides of each edge, so that no known values are skipped.
    after = np.searchsorted(times, even)
    return times[np.unique(np.clip(np.append(after, after - 1), 0, len(times) - 1))]


def _middle(low: FloatArray, high: FloatArray, times: FloatArray | None) -> FloatArray:
    """A time within each step, that of a return if they are given; `low` where there is none."""
    if times is None:
        return (low + high) / 2.0
    after, before = np.searchsorted(times, low, "right"), np.searchsorted(times, high) - 1
    return np.where(after <= before, times[np.minimum((after + before) // 2, len(times) - 1)], low)


def _none(*values: FloatArray) -> BoolArray:
    """Whether nothing is known at the ends of a step and in its middle."""
    none: BoolArray = np.all([~np.isfinite(value).all(axis=1) for value in values], axis=0)
    return none
