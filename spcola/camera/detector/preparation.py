"""From the pixels of an image file to those of SPC, in the order of the calibration equation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera.detector.bit_depth import BitDepth, Bits, StoredPixels, scaling_for, to_unsigned
from spcola.camera.detector.frames import divide_flat, subtract_dark
from spcola.camera.detector.pixels import PixelValues
from spcola.camera.detector.smear import FrameTransfer, remove_smear
from spcola.camera.detector.thresholds import bright_threshold, check_thresholds, shadow_threshold
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class Preparation:
    """What is done to the pixels of one camera.

    Parameters
    ----------
    gamma : float
        Brightness is the number in the file to this power: 2 of square-root encoding, 1 where both
        are proportional.
    dark, flat : (lines, samples) ndarray, optional
        Dark frame and flat field; of brightness, not of encoded numbers.
    dark_scale : float
        Ratio of the exposure times of image and dark frame.
    smear : FrameTransfer, optional
        Times of the frame transfer.
    depth : BitDepth, optional
        Scaling; if not given, by :func:`scaling_for` with `bits`.
    bits : {8, 16}, optional
        Of a stored pixel; if not given, 8 for a file of 8 bits without sign that is not encoded,
        otherwise 16.
    low, high : int, optional
        Thresholds in DN; if not given, `low` by :func:`shadow_threshold`, and `high` the largest
        DN, less 1 if pixels are saturated.
    bright_background : bool
        Whether `high`, if not given, is that of :func:`bright_threshold`.

    Raises
    ------
    InvalidValueError
        If gamma is not positive.
    """

    gamma: float = 1.0
    dark: FloatArray | None = None
    flat: FloatArray | None = None
    dark_scale: float = 1.0
    smear: FrameTransfer | None = None
    depth: BitDepth | None = None
    bits: Bits | None = None
    low: int | None = None
    high: int | None = None
    bright_background: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.gamma < np.inf:
            raise InvalidValueError(f"is {self.gamma}", "gamma", "give a positive number")


@dataclass(frozen=True, eq=False)
class PreparedPixels:
    """Pixels of an SPC image and its thresholds.

    Parameters
    ----------
    stored : StoredPixels
    thresholds : (2,) of int
        Lowest and highest DN that is used.
    """

    stored: StoredPixels
    thresholds: tuple[int, int]


def prepare_pixels(pixels: PixelValues, preparation: Preparation) -> PreparedPixels:
    """Undo encoding, subtract dark, remove smear, divide by the flat field, scale, find thresholds.

    Parameters
    ----------
    pixels : PixelValues
        Of the whole image, in the file's order.
    preparation : Preparation

    Raises
    ------
    InvalidValueError
        If a frame has another shape, or nothing can be scaled.
    NotObservableError
        If a threshold cannot be found.
    """
    raw = pixels.values.dtype
    encoded = preparation.gamma != 1.0
    if encoded:
        pixels = decoded(pixels, preparation.gamma)
    if preparation.dark is not None:
        pixels = subtract_dark(pixels, preparation.dark, scale=preparation.dark_scale)
    if preparation.smear is not None:
        pixels = remove_smear(pixels, preparation.smear)
    if preparation.flat is not None:
        pixels = divide_flat(pixels, preparation.flat)
    bits: Bits = preparation.bits or (
        8 if raw.kind == "u" and raw.itemsize == 1 and not encoded else 16
    )
    stored = to_unsigned(pixels, preparation.depth or scaling_for(pixels, bits))
    return PreparedPixels(stored, _thresholds(stored, preparation))


def decoded(pixels: PixelValues, gamma: float) -> PixelValues:
    """Return pixels whose values are proportional to light: those in the file to a power.

    Products for browsing, and frames that were encoded on board, have numbers that grow as a root
    of the brightness. Numbers below 0, which such an encoding does not have, become 0.

    Parameters
    ----------
    pixels : PixelValues
    gamma : float
    """
    values = np.where(pixels.valid, pixels.values, 0).astype(np.float64)
    return pixels.with_values(np.maximum(values, 0.0) ** gamma)


def _thresholds(stored: StoredPixels, preparation: Preparation) -> tuple[int, int]:
    """Return the thresholds that are given or found."""
    largest = stored.depth.largest
    low = shadow_threshold(stored) if preparation.low is None else preparation.low
    high = preparation.high
    if high is None and preparation.bright_background:
        high = bright_threshold(stored, low)
    if high is None:
        high = largest - 1 if stored.saturated or stored.above else largest
    return check_thresholds(low, high, largest)
