"""Directions from the centre of a body: longitude and latitude, and axes along them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray

# Sine of the distance from a pole within which there is no east.
_POLE = 1e-6


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


def local_axes(up: ArrayLike) -> FloatArray:
    """Return the axes of SPC at directions: south, east and up.

    At a pole, where east is undefined, the second axis is the body's +Y turned into the plane
    across the direction.

    Parameters
    ----------
    up : (…, 3) array_like
        Body-fixed, of any length but zero.

    Returns
    -------
    (…, 3, 3) ndarray
        The unit vectors Ux, Uy and Uz as rows.
    """
    directions = np.asarray(up, dtype=np.float64)
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    x, y, z = unit[..., 0], unit[..., 1], unit[..., 2]
    across = np.hypot(x, y)
    at_pole = across < _POLE
    east = np.where(at_pole, [-x * y, 1.0 - y * y, -y * z], [-y, x, np.zeros_like(x)])
    east /= np.where(at_pole, np.sqrt(1.0 - y * y), across)
    e, f, g = east
    rows = np.array([[f * z - g * y, g * x - e * z, e * y - f * x], east, [x, y, z]])
    return np.moveaxis(rows, (0, 1), (-2, -1))
