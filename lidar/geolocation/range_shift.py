"""Ranges that count from another point of the instrument than was taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class RangeShift:
    """How a correction of all ranges of one scan moves its returns: along their beams.

    Attributes
    ----------
    shift_m : float
        Added to every range, metres.
    time : (K,) ndarray
        Seconds, ascending.
    station : (K, 3) ndarray
        Where the spacecraft was, body-fixed, metres, as the returns were located. Straight lines
        between the times: a beam's direction is all that is asked of them.
    """

    shift_m: float
    time: FloatArray
    station: FloatArray

    def apply(self, points: FloatArray, time: FloatArray) -> FloatArray:
        """Return the points (N, 3), metres, at the corrected ranges; NaN at unknown times."""
        station = np.stack([np.interp(time, self.time, axis) for axis in self.station.T], axis=1)
        beam = points - station
        with np.errstate(invalid="ignore", divide="ignore"):
            moved: FloatArray = points + self.shift_m * beam / np.linalg.norm(
                beam, axis=1, keepdims=True
            )
        return moved
