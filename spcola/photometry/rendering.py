"""Rendering: the expected brightness of ground in an image, resampled to its grid."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.photometry.expected_pixels import expected_pixels
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.photometry.ground import at_cells
from spcola.photometry.image_blur import ImageBlur
from spcola.photometry.ortho_image import View, resampled

# Largest weight of pixels next to ones not filled by the ground in the interpolation of a point.
_UNFILLED = 0.25


def render_view(
    view: View,
    *,
    function: PhotometricFunction = lunar_lambert,
    albedo: FloatArray | None = None,
    blur: ImageBlur | None = None,
) -> FloatArray:
    """Return the relative brightness (R, C) of the ground of a view [16, 17].

    ``(1 + tz) Φ(cos i, cos e, phase)`` of each cell, less its share in shadow, is averaged over the
    pixels of the image (:func:`spcola.photometry.expected_pixels.expected_pixels`), which are then
    resampled to the grid by :func:`spcola.photometry.ortho_rectify`, like those of the image:
    pixel size, foreshortening and interpolation have the same effect on both.

    Parameters
    ----------
    view : View
    function : PhotometricFunction
    albedo : (R, C) ndarray, optional
        Relative albedo 1 + tz; 1 if not given.
    blur : ImageBlur, optional
        Of the image; none if not given.

    Returns
    -------
    (R, C) ndarray
        NaN where the ground is not visible, and where it does not fill its pixels: at the edges of
        the grid and around unknown heights.
    """
    value = function(view.cos_incidence, view.cos_emission, view.phase)
    if albedo is not None:
        value = value * at_cells(albedo)
    lit = at_cells(np.where(np.isfinite(view.pixel), view.lit, np.nan))
    value = np.where(np.isfinite(view.cos_incidence), value * lit, np.nan)
    rendered = np.full(view.seen.shape, np.nan)
    expected = expected_pixels(view, value, blur=blur)
    if not expected.known.any():
        return rendered
    place = np.stack([view.line[view.seen], view.pixel[view.seen]]) - 1.0 - expected.first[:, None]
    rim = ndimage.binary_dilation(~expected.known, np.ones((3, 3), dtype=np.bool_)).astype(
        np.float64
    )
    unfilled = ndimage.map_coordinates(rim, place, order=1, mode="nearest")
    brightness = resampled(expected.value, place, view.footprint)
    rendered[view.seen] = np.where(unfilled <= _UNFILLED, brightness, np.nan)
    return rendered
