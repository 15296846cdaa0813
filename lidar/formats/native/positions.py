"""Position of the spacecraft during a scan, in few numbers.

A table repeats the position at each of a million shots; the path between them is smooth. A spline
through some of them is stored instead, if it fits all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline

# Fewest knots of a cubic spline.
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
        positions = np.empty((len(time), 3))
        _evaluate(self.time, self._coefficients, time, positions)
        return positions

    def misses(self, time: FloatArray, position: FloatArray, tolerance: float) -> bool:
        """Return whether some of the positions (N, 3) are off by more than a tolerance, metres.

        Their times (N,), seconds, never fall, and lie within the knots.
        """
        begin = np.searchsorted(time, self.time)
        # The last knot belongs to the last piece.
        begin[-1] = len(time)
        return bool(_misses(self.time, self._coefficients, begin, time, position, tolerance))

    @cached_property
    def _coefficients(self) -> FloatArray:
        """Coefficients of each piece (K − 1, 4, 3), the cube's first."""
        # As long to import as all of NumPy.
        from scipy.interpolate import CubicSpline  # noqa: PLC0415

        pieces = CubicSpline(self.time, self.position).c
        return np.ascontiguousarray(np.moveaxis(pieces, 1, 0))


def fit_flight(time: FloatArray, position: FloatArray, tolerance: float) -> Flight | None:
    """Return a spline that fits all positions, or None if it would save little.

    Parameters
    ----------
    time : (N,) ndarray
        Seconds; any order, also repeated.
    position : (N, 3) ndarray
        Body-fixed, metres.
    tolerance : float
        Largest deviation from a position, metres along an axis.

    Returns
    -------
    Flight or None
        None where a position or time is not finite, or the path is too rough for an eighth as many
        knots as there are times.
    """
    if not _all_finite(time, position):
        return None
    first, rises = _first_rows(time)
    if not rises:
        rising = np.argsort(time, kind="stable")
        time, position = time[rising], position[rising]
        first, _ = _first_rows(time)
    knots = _FEWEST
    while knots <= len(first) // 8:
        chosen = first[np.unique(np.linspace(0, len(first) - 1, knots).round().astype(np.intp))]
        flight = Flight(time[chosen], position[chosen])
        # A few rows show soonest that there are too few knots.
        for rows in (slice(None, None, 1 + len(time) // 1000), slice(None)):
            if flight.misses(time[rows], position[rows], tolerance):
                break
        else:
            return flight
        knots = 2 * knots - 1
    return None


@compiled
def _all_finite(time: FloatArray, position: FloatArray) -> bool:
    """Return whether all times (N,) and positions (N, 3) are finite, without a temporary of N."""
    sum_of_none = 0.0
    for n in range(len(time)):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        # Zero times a number is zero, times NaN or infinity it is NaN.
        sum_of_none += 0.0 * time[n] + 0.0 * x + 0.0 * y + 0.0 * z
    return sum_of_none == 0.0


@compiled
def _first_rows(time: FloatArray) -> tuple[IntArray, bool]:
    """Rows with another time than the one before, and whether times never fall."""
    first = np.empty(len(time), dtype=np.int64)
    count = 0
    rises = True
    for n in range(len(time)):
        before = time[n - 1] if n else -np.inf
        first[count] = n
        count += time[n] != before
        rises &= time[n] >= before
    return first[:count], rises


@compiled_inline
def _piece(knots: FloatArray, time: float, last: int) -> int:
    """Number of the piece that contains a time, searched from the last one; −1 outside."""
    if not knots[0] <= time <= knots[-1]:
        return -1
    if not knots[last] <= time:
        last = 0
    if time <= knots[last + 1]:
        return last
    after = int(np.searchsorted(knots, time, side="right"))
    return min(after - 1, len(knots) - 2)


@compiled_inline
def _value(pieces: FloatArray, piece: int, axis: int, since: float) -> float:
    """Coordinate along an axis, metres, `since` seconds after the piece's first knot."""
    c = pieces[piece]
    return ((c[0, axis] * since + c[1, axis]) * since + c[2, axis]) * since + c[3, axis]


@compiled
def _evaluate(
    knots: FloatArray, pieces: FloatArray, time: FloatArray, positions: FloatArray
) -> None:
    piece = 0
    for n in range(len(time)):
        found = _piece(knots, time[n], piece)
        if found < 0:
            positions[n] = np.nan
            continue
        piece = found
        for axis in range(3):
            positions[n, axis] = _value(pieces, piece, axis, time[n] - knots[piece])


@compiled
def _misses(
    knots: FloatArray,
    pieces: FloatArray,
    begin: IntArray,
    time: FloatArray,
    position: FloatArray,
    tolerance: float,
) -> bool:
    for piece in range(len(pieces)):
        first, end = begin[piece], begin[piece + 1]
        for axis in range(3):
            # Without a branch, so that several rows are compared at once.
            met = True
            for n in range(first, end):
                value = _value(pieces, piece, axis, time[n] - knots[piece])
                met &= abs(value - position[n, axis]) <= tolerance
            if not met:
                return True
    return False
