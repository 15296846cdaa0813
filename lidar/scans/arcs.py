"""Arcs: long scans cut into spans of time with a common displacement.

The errors of trajectory and pointing hardly change over some minutes, in which a raster is swept. A
track of hours goes round the body meanwhile: an error along its path at first becomes one across
it, or up, later on, and no single displacement describes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Arcs:
    """Arcs of equal length into which a scan is cut.

    Parameters
    ----------
    start : float
        Beginning of the first, ephemeris time, s.
    width : float
        Length of each, s.
    count : int
    """

    start: float = 0.0
    width: float = np.inf
    count: int = 1

    @classmethod
    def of_span(cls, span: tuple[float, float], longest: float) -> Arcs:
        """Cut a `span` of times into arcs of at most `longest` seconds; one of NaN is not cut."""
        length = span[1] - span[0]
        if not length > longest:
            return cls()
        count = int(np.ceil(length / longest))
        return cls(span[0], length / count, count)

    def numbers(self, time: FloatArray) -> IntArray:
        """Return the arc (N,) of each time; unknown times belong to the first."""
        number = np.floor((np.nan_to_num(time, nan=self.start) - self.start) / self.width)
        numbers: IntArray = np.clip(number, 0, self.count - 1).astype(np.int32)
        return numbers

    def names(self, scan: str) -> list[str]:
        """Return the names of the arcs: the scan's own, with numbers if there are several."""
        if self.count == 1:
            return [scan]
        digits = len(str(self.count))
        return [f"{scan}:{number:0{digits}}" for number in range(1, self.count + 1)]
