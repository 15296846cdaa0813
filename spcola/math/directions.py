"""Directions from the centre of a body as longitude and latitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray


def lon_lat_deg(points: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return planetocentric east longitude (0 … 360) and latitude (…), degrees.

    Parameters
    ----------
    points : (…, 3) array_like
        Body-fixed, of any length. NaN points have NaN directions; the longitude of a pole is 0.
    """
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    # A longitude a rounding error below 0 comes out of the modulus as 360 itself.
    longitude = np.degrees(np.arctan2(y, x)) % 360.0 % 360.0
    return longitude, np.degrees(np.arctan2(z, np.hypot(x, y)))
