"""Correction of ranges that count from another point of the instrument than assumed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class RangeShift:
    """Displacement of the returns of one scan along their beams by a correction of all ranges.

    Attributes
    ----------
    shift_m : float
        Added to every range, metres.
    time : (K,) ndarray
        Seconds, ascending.
    station : (K, 3) ndarray
        Position of the spacecraft, body-fixed, metres, by which the returns were located.
        Interpolated linearly: only the direction of a beam depends on it.
    """

    shift_m: float
    time: FloatArray
    station: FloatArray

    def apply(self, points: FloatArray, time: FloatArray) -> FloatArray:
        """Return body-fixed `points` (N, 3), metres, at the corrected ranges.

        NaN where their ephemeris `time` (N,), s, is unknown.
        """
        station = np.stack([np.interp(time, self.time, axis) for axis in self.station.T], axis=1)
        beam = points - station
        with np.errstate(invalid="ignore", divide="ignore"):
            moved: FloatArray = points + self.shift_m * beam / np.linalg.norm(
                beam, axis=1, keepdims=True
            )
        return moved
