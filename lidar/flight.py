"""Where the spacecraft was during a scan, in few numbers.

A table repeats the position at each of a million shots; the path between them is smooth. A spline
through some of them is kept instead, if it meets all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from spcola.arrays import FloatArray

# A cubic through fewer knots is none.
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class Flight:
    """A cubic spline through K positions.

    Parameters
    ----------
    time : (K,) ndarray
        Seconds, rising.
    position : (K, 3) ndarray
        Body-fixed, metres.
    """

    time: FloatArray
    position: FloatArray

    def at(self, time: FloatArray) -> FloatArray:
        """Return positions (N, 3), metres, at the times (N,), seconds; NaN outside the knots."""
        spline = CubicSpline(self.time, self.position, extrapolate=False)
        positions: FloatArray = spline(time)
        return positions


def fit_flight(time: FloatArray, position: FloatArray, tolerance: float) -> Flight | None:
    """Find a spline that meets all positions, or nothing if it would save little.

    Parameters
    ----------
    time : (N,) ndarray
        Seconds; any order, also repeated.
    position : (N, 3) ndarray
        Body-fixed, metres.
    tolerance : float
        Largest distance from a position that is allowed, metres along an axis.

    Returns
    -------
    Flight or None
        None where a position or time is not finite, or the path is too rough for an eighth as many
        knots as there are times.
    """
    if not (np.isfinite(time).all() and np.isfinite(position).all()):
        return None
    if (np.diff(time) < 0).any():
        rising = np.argsort(time, kind="stable")
        time, position = time[rising], position[rising]
    first = np.flatnonzero(np.diff(time, prepend=-np.inf))
    knots = _FEWEST
    while knots <= len(first) // 8:
        chosen = first[np.unique(np.linspace(0, len(first) - 1, knots).round().astype(np.intp))]
        flight = Flight(time[chosen], position[chosen])
        # A sample tells soonest that there are too few knots.
        for rows in (slice(None, None, 1 + len(time) // 1000), slice(None)):
            if np.abs(flight.at(time[rows]) - position[rows]).max() > tolerance:
                break
        else:
            return flight
        knots = 2 * knots - 1
    return None
