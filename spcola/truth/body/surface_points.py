"""Points of a body's surface: hits of rays, or the points nearest to points in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, check_shape
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """First hits of N rays, NaN for a ray that misses; or the surface points nearest to N points.

    Parameters
    ----------
    distance : (N,) ndarray
        From each origin along its ray, metres; or from each point, negative inside of the body.
    points : (N, 3) ndarray
        On the surface, body-fixed, metres.
    normals : (N, 3) ndarray
        Unit normals of the surface there, outward.

    Raises
    ------
    InvalidValueError
        If the shapes disagree.
    """

    distance: FloatArray
    points: FloatArray
    normals: FloatArray

    def __post_init__(self) -> None:
        if self.distance.ndim != 1:
            raise InvalidValueError(f"has shape {self.distance.shape}, not (N,)", "distance")
        for name in ("points", "normals"):
            check_shape(getattr(self, name), (len(self.distance), 3), name)

    def __len__(self) -> int:
        return len(self.distance)

    @property
    def hit(self) -> BoolArray:
        """Which rays (N,) meet the body."""
        return np.isfinite(self.distance)
