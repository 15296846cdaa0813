"""Summary of a scan without its returns."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lidar.scans.scan import Scan
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class ScanSummary:
    """Contents of a scan file known without reading its returns.

    Parameters
    ----------
    name, trajectory, body : str
        As in `Scan`.
    count : int
        Accepted returns.
    rejected : mapping of str to int
        Returns left out, by reason.
    time_span : (float, float)
        First and last ephemeris time, s; NaN if no time is known.
    bounds : (2, 3) ndarray
        Least and greatest x, y, z of the returns, metres; NaN if there is none.
    digest : str
        Digest of the source file.
    parameters : mapping of str to str, float or int
        Scan parameters that came with the source.
    """

    name: str
    count: int
    rejected: Mapping[str, int]
    time_span: tuple[float, float]
    trajectory: str
    body: str
    bounds: np.ndarray[Any, np.dtype[np.float64]]
    digest: str = ""
    parameters: Mapping[str, str | float | int] = field(default_factory=dict)

    @classmethod
    def of(cls, scan: Scan) -> ScanSummary:
        """Return the summary of a scan, or of its first chunk."""
        known = scan.time[np.isfinite(scan.time)]
        span = (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)
        bounds = np.full((2, 3), np.nan)
        if len(scan):
            # Axis by axis: along the short rows of the array it takes ten times as long.
            bounds = np.array([[axis.min(), axis.max()] for axis in scan.points.T]).T
        return cls(
            name=scan.name,
            count=len(scan),
            rejected=scan.rejected,
            time_span=span,
            trajectory=scan.trajectory,
            body=scan.body,
            bounds=bounds,
        )

    def extended(self, scan: Scan, path: str | Path) -> ScanSummary:
        """Return the summary with the next chunk added, of the scan at `path`.

        Raises
        ------
        InvalidValueError
            If the chunk lies in another frame.
        """
        if (scan.trajectory, scan.body) != (self.trajectory, self.body):
            raise InvalidValueError("chunks lie in different frames", path)
        added = ScanSummary.of(scan)
        rejected = Counter(self.rejected)
        rejected.update(scan.rejected)
        times = np.array([self.time_span, added.time_span])
        low, high = (np.array([self.bounds[k], added.bounds[k]]) for k in (0, 1))
        return replace(
            self,
            count=self.count + added.count,
            rejected=rejected,
            # fmin and fmax ignore NaN, the span or bounds of a chunk without any.
            time_span=(float(np.fmin(*times[:, 0])), float(np.fmax(*times[:, 1]))),
            bounds=np.stack([np.fmin(*low), np.fmax(*high)]),
        )
