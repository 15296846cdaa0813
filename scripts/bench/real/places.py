"""Latitude and longitude of places on a body."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray


def latitude_longitude(point: FloatArray) -> tuple[float, float]:
    """Return latitude and east longitude of a point (3,), degrees; the latter 0 … 360."""
    x, y, z = point
    latitude = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return float(latitude), float(np.degrees(np.arctan2(y, x)) % 360.0)
