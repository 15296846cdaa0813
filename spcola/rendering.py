"""Rendering: the brightness that an image should show of ground, at the image's resolution."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.orthoimage import View
from spcola.photometry import PhotometricFunction, lunar_lambert

# Of the variance of a box of width 1: of a pixel, pixels², or of a cell, grid steps².
_BOX = 1.0 / 12.0
# Standard deviations that a blur reaches, and the share of it that has to rest on known points.
_REACH, _SUPPORT = 3.0, 0.5
# A blur of less than this, grid steps, changes nothing.
_NO_BLUR = 0.2


def render(
    view: View,
    *,
    function: PhotometricFunction = lunar_lambert,
    albedo: FloatArray | None = None,
    psf_px: float = 0.0,
) -> FloatArray:
    """Return the relative brightness (R, C) of the ground of a view [16, 17].

    ``(1 + tz) Φ(cos i, cos e, phase)`` where it is lit, 0 in shadow, blurred by what the
    image's pixels and optics cover beyond a cell of the grid.

    Parameters
    ----------
    view : View
    function : callable
        Photometric function Φ.
    albedo : (R, C) ndarray, optional
        Relative albedo 1 + tz; 1 if not given.
    psf_px : float
        Standard deviation of the optics' point spread, pixels.

    Returns
    -------
    (R, C) ndarray
        NaN where the height or a slope is not known, or too little around is.
    """
    with np.errstate(invalid="ignore"):
        value = function(view.cos_incidence, view.cos_emission, view.phase)
    if albedo is not None:
        value = value * albedo
    known = np.isfinite(view.cos_incidence)
    sharp = np.where(known, np.where(view.lit, value, 0.0), np.nan)
    return smoothed(sharp, blur_of(view.footprint, psf_px))


def blur_of(footprint: FloatArray, psf_px: float = 0.0) -> FloatArray:
    """Return the covariance (2, 2) of what a pixel and the optics blur, (x, y) grid steps².

    Of a pixel smaller than a cell the image's mean over the cell is left: nothing.
    """
    ground = np.linalg.inv(footprint)
    spread = (_BOX + psf_px**2) * ground @ ground.T
    values, vectors = np.linalg.eigh(spread)
    left = np.maximum(values - _BOX, 0.0)
    blur: FloatArray = (vectors * left) @ vectors.T
    return blur


def smoothed(layer: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return a layer (R, C) under a Gaussian of `covariance` (2, 2), (x, y) grid steps².

    NaN where the layer is, and where less than half of the weight around is known.
    """
    width = float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
    if width < _NO_BLUR:
        return layer
    # Along the narrow axis a Gaussian that falls between the points would alias.
    covariance = covariance + 0.1 * np.eye(2)
    reach = int(np.ceil(_REACH * np.sqrt(width**2 + 0.1)))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    away = np.stack([x, y], axis=-1)
    kernel = np.exp(-0.5 * np.einsum("rci,ij,rcj->rc", away, np.linalg.inv(covariance), away))
    kernel /= kernel.sum()
    known = np.isfinite(layer)
    weight = ndimage.convolve(known.astype(np.float64), kernel, mode="constant")
    total = ndimage.convolve(np.where(known, layer, 0.0), kernel, mode="constant")
    inside = ndimage.convolve(np.ones(layer.shape), kernel, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        soft: FloatArray = total / weight
    return np.where(known & (weight > _SUPPORT * inside), soft, np.nan)
