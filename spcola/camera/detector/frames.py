"""Dark frame and flat field."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, check_shape
from spcola.camera.detector.pixels import PixelValues
from spcola.errors import InvalidValueError


def subtract_dark(pixels: PixelValues, dark: FloatArray, *, scale: float = 1.0) -> PixelValues:
    """Return ``values − scale × dark``.

    Parameters
    ----------
    pixels : PixelValues
        Raw brightness.
    dark : (lines, samples) or (lines, 1) or (1, 1) array
        Frame without light, one level for each line, or one level, in the pixels' unit. NaN where
        unknown: those pixels become missing.
    scale : float
        Ratio of the exposure times, where the dark frame has another one and no bias.

    Raises
    ------
    InvalidValueError
        If the shapes do not fit.
    """
    level = _fitting(dark, pixels, "dark frame")
    values = pixels.values.astype(np.float64) - scale * level
    return _with_unknown(pixels, values, ~np.isfinite(level))


def divide_flat(pixels: PixelValues, flat: FloatArray) -> PixelValues:
    """Return ``values / (flat / mean of flat)``.

    Parameters
    ----------
    pixels : PixelValues
        Brightness without dark signal and smear.
    flat : (lines, samples) array
        Response to uniform light, any unit: its mean over the usable pixels is made 1. Pixels
        whose response is not positive become missing.

    Raises
    ------
    InvalidValueError
        If the shape differs, or no pixel responds.
    """
    response = _fitting(flat, pixels, "flat field")
    usable = np.isfinite(response) & (response > 0)
    if not np.any(usable):
        raise InvalidValueError("has no positive pixel", "flat field")
    relative = np.where(usable, response, np.nan) / np.mean(response, where=usable)
    return _with_unknown(pixels, pixels.values / relative, ~usable)


def _fitting(frame: FloatArray, pixels: PixelValues, name: str) -> FloatArray:
    """Return a frame as float64 if it fits the pixels."""
    frame = np.asarray(frame, dtype=np.float64)
    lines, samples = pixels.values.shape
    if frame.ndim == 2 and frame.shape in ((lines, 1), (1, 1)) and name == "dark frame":
        return np.broadcast_to(frame, (lines, samples))
    check_shape(frame, (lines, samples), name)
    return frame


def _with_unknown(pixels: PixelValues, values: FloatArray, unknown: np.ndarray) -> PixelValues:
    """Return pixels with `values`; those of `unknown` are missing."""
    missing = pixels.missing | (unknown & ~pixels.saturated)
    return PixelValues(values, missing, pixels.dark & ~missing, pixels.saturated)
