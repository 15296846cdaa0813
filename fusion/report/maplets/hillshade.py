"""Shaded relief and slope of heights on a grid."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray


def hillshade(height: FloatArray, gsd: float) -> FloatArray:
    """Shade (rows along Ux, columns along Uy) of `height`, 0 … 1; light from the upper left.

    Parameters
    ----------
    height : (2q+1, 2q+1) ndarray
        Metres, indexed as on a maplet.
    gsd : float
        Metres.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        As an image: first row at the top. NaN where the height is unknown.
    """
    image = height.T
    down, right = np.nan_to_num(_slope(image, gsd)), np.nan_to_num(_slope(image.T, gsd).T)
    # Sun at 45° elevation, from the upper left of the image.
    light = np.array([-0.5, -0.5, np.sqrt(0.5)])
    cosine = (light[2] - light[0] * right - light[1] * down) / np.sqrt(1 + right**2 + down**2)
    shade: FloatArray = np.where(np.isfinite(image), np.clip(cosine, 0.0, 1.0), np.nan)
    return shade


def slope_deg(height: FloatArray, gsd: float) -> FloatArray:
    """Return the angle, degrees, between the ground and the plane of the grid.

    Parameters
    ----------
    height : (2q+1, 2q+1) ndarray
        Metres, indexed as on a maplet.
    gsd : float
        Metres.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        As an image, like :func:`hillshade`; NaN where the height, or both neighbours along a side,
        are unknown.
    """
    image = height.T
    steepest = np.hypot(_slope(image, gsd), _slope(image.T, gsd).T)
    return np.where(np.isfinite(image), np.degrees(np.arctan(steepest)), np.nan)


def _slope(image: FloatArray, gsd: float) -> FloatArray:
    """Return the slope down the rows: mean of the steps to known neighbours; NaN if none is."""
    steps = np.diff(image, axis=0, append=np.nan) / gsd
    before = np.vstack([np.full((1, image.shape[1]), np.nan), steps[:-1]])
    known = np.isfinite(steps).astype(float) + np.isfinite(before)
    both = np.nan_to_num(steps) + np.nan_to_num(before)
    return np.where(known > 0, both / np.maximum(known, 1.0), np.nan)
