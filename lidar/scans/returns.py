"""Returns: the input of gridding, from the echoes of one or many scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidar.scans.scan import Scan
from spcola.arrays import AnyArray, FloatArray, IntArray, check_finite, check_shape, read_only
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class Returns:
    """N returns, of one or of several scans, in any order.

    Parameters
    ----------
    points : (N, 3) ndarray
        Body-fixed positions, metres; always finite.
    sigma : (N,) ndarray
        One standard deviation of a single return, metres; NaN if unknown.
    scan : (N,) integer ndarray
        Which of `scan_names` each return belongs to.
    scan_names : tuple of str
        Names of the scans.

    Raises
    ------
    InvalidValueError
        If lengths differ, a point is not finite, a sigma is not positive, or a return refers to a
        scan that is not there.
    """

    points: FloatArray
    sigma: FloatArray
    scan: IntArray
    scan_names: tuple[str, ...]

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=np.float64)
        sigma = np.asarray(self.sigma, dtype=np.float64)
        scan = np.asarray(self.scan)
        check_shape(points, (None, 3), "points")
        check_shape(sigma, (len(points),), "sigma")
        check_shape(scan, (len(points),), "scan")
        check_finite(points, "points")
        if (sigma <= 0).any() or np.isinf(sigma).any():
            raise InvalidValueError("must be positive and finite, or NaN where unknown", "sigma")
        if not np.issubdtype(scan.dtype, np.integer):
            raise InvalidValueError(f"is {scan.dtype}, integers are needed", "scan")
        if scan.size and (scan.min() < 0 or scan.max() >= len(self.scan_names)):
            raise InvalidValueError("names a scan that is not in scan_names", "scan")
        object.__setattr__(self, "points", read_only(points))
        object.__setattr__(self, "sigma", read_only(sigma))
        object.__setattr__(self, "scan", read_only(scan))
        object.__setattr__(self, "scan_names", tuple(self.scan_names))

    @classmethod
    def of_scans(cls, scans: Sequence[Scan]) -> Returns:
        """Collect the returns of `scans`; chunks of one name count as one scan.

        Raises
        ------
        InvalidValueError
            If the scans lie in different body-fixed frames.
        """
        if len({scan.body for scan in scans}) > 1:
            raise InvalidValueError("lie in different body-fixed frames", "scans")
        names = tuple(dict.fromkeys(scan.name for scan in scans))
        index = [np.full(len(scan), names.index(scan.name), dtype=np.int32) for scan in scans]
        return cls(
            np.concatenate([np.empty((0, 3)), *(scan.points for scan in scans)]),
            np.concatenate([np.empty(0), *(scan.sigma for scan in scans)]),
            np.concatenate([np.empty(0, dtype=np.int32), *index]),
            names,
        )

    def __len__(self) -> int:
        return len(self.points)

    def select(self, keep: AnyArray) -> Returns:
        """Return the returns chosen by `keep` (mask, slice or indices); the names are unchanged."""
        return Returns(self.points[keep], self.sigma[keep], self.scan[keep], self.scan_names)

    def of_own_scans(self) -> Returns:
        """Return the same returns with the names of their own scans only."""
        own, scan = np.unique(self.scan, return_inverse=True)
        names = tuple(self.scan_names[number] for number in own)
        return Returns(self.points, self.sigma, scan.astype(np.int32), names)
