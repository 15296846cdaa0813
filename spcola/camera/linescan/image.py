"""A line-scan image with its states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.camera.linescan.scan import LineScan, scan_rays
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class LineScanImage:
    """A line-scan image: what :class:`spcola.camera.SpcImage` is of a framing camera.

    Parameters
    ----------
    name : str
        At most 12 characters.
    scan : LineScan
        Camera, and a state for each line.
    sun : (3,) array_like
        Unit vector from the surface to the Sun at the middle line, body-fixed.
    thresholds : (2,) of int
        Lowest and highest brightness that is used.

    Raises
    ------
    InvalidValueError
        If the direction to the Sun is not finite or no unit vector.
    """

    name: str
    scan: LineScan
    sun: FloatArray
    thresholds: tuple[int, int] = (0, 65535)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sun", frozen(self.sun, (3,), f"{self.name}.sun"))
        check_finite(self.sun, f"{self.name}.sun")
        if abs(float(np.linalg.norm(self.sun)) - 1.0) > 1e-5:
            raise InvalidValueError("is not a unit vector", f"{self.name}.sun")

    @property
    def size(self) -> tuple[int, int]:
        """Samples and lines."""
        return self.scan.camera.width, self.scan.height

    @property
    def pixel_angle(self) -> float:
        """Angle that one pixel subtends along the detector's line, radians."""
        return self.scan.camera.pixel_angle

    def rays(self, pixel: FloatArray, line: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return origins (N, 3), metres, and unit vectors (N, 3) of rays, body-fixed.

        Parameters
        ----------
        pixel, line : (N,) ndarray
            From (1, 1) in the middle of the first pixel of the first line.
        """
        return scan_rays(self.scan, pixel, line)
