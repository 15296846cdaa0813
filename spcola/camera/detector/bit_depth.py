"""Brightness as SPC stores it: 8 or 16 bits without sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from spcola.arrays import AnyArray
from spcola.camera.detector.pixels import PixelValues
from spcola.errors import InvalidValueError

Bits = Literal[8, 16]

# A brightest pixel so many times above nearly all others is a cosmic ray or a hot pixel.
_HEADROOM = 4.0
_NEARLY_ALL = 99.9


@dataclass(frozen=True)
class BitDepth:
    """Linear scaling ``DN = gain × value + offset``, rounded.

    Parameters
    ----------
    bits : {8, 16}
        Of a stored pixel.
    gain : float
        DN for one unit of brightness, positive.
    offset : float
        DN of brightness 0.

    Raises
    ------
    InvalidValueError
        If a number is impossible.
    """

    bits: Bits = 16
    gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if self.bits not in (8, 16):
            raise InvalidValueError(f"is {self.bits}", "bits of a pixel", "SPC has 8 or 16")
        if not (np.isfinite(self.gain) and self.gain > 0 and np.isfinite(self.offset)):
            raise InvalidValueError(
                f"has gain {self.gain} and offset {self.offset}", "scaling", "give a positive gain"
            )

    @property
    def largest(self) -> int:
        """Largest DN."""
        return (1 << self.bits) - 1


@dataclass(frozen=True, eq=False)
class StoredPixels:
    """Pixels in SPC's form.

    Parameters
    ----------
    dn : (lines, samples) ndarray of uint8 or uint16
        0: missing, saturated at the low end, or below the range. The largest number: saturated or
        above the range.
    depth : BitDepth
        ``value = (dn − offset) / gain``.
    missing, saturated : int
        Numbers of such pixels in the file.
    below, above : int
        Numbers of measured pixels outside the range, cut to it.
    """

    dn: AnyArray
    depth: BitDepth
    missing: int
    saturated: int
    below: int
    above: int


def scaling_for(pixels: PixelValues, bits: Bits = 16) -> BitDepth:
    """Return a scaling to `bits` (8 or 16) for pixels of any type.

    Integers that fit are kept (gain 1, offset 0). Other values keep their ratios (offset 0): the
    largest becomes one less than the largest DN. If it is more than four times the 99.9th
    percentile, four times that percentile does: a single hot pixel must not cost the other ones
    their resolution. Images of one camera that are compared need one given scaling.

    Raises
    ------
    InvalidValueError
        If no pixel is valid, or none is positive.
    """
    values = pixels.values[pixels.valid]
    largest = BitDepth(bits).largest
    if not len(values) or not np.max(values) > 0:
        what = "has no positive pixel" if len(values) else "has no valid pixel"
        raise InvalidValueError(what, "image", "give gain and offset")
    top = float(np.max(values))
    if values.dtype.kind in "ui" and np.min(values) >= 0 and top <= largest:
        return BitDepth(bits)
    usual = _HEADROOM * float(np.percentile(values, _NEARLY_ALL))
    return BitDepth(bits, (largest - 1) / (min(top, usual) if usual > 0 else top))


def to_unsigned(pixels: PixelValues, depth: BitDepth) -> StoredPixels:
    """Scale pixels to 8 or 16 bits without sign.

    Parameters
    ----------
    pixels : PixelValues
    depth : BitDepth

    Returns
    -------
    StoredPixels
        Missing and low-saturated pixels are 0, saturated ones the largest DN. Measured values are
        rounded (halves to even) and cut to the range.
    """
    kind = np.uint8 if depth.bits == 8 else np.uint16
    values = pixels.values
    exact = values.dtype.kind == "u" and values.dtype.itemsize * 8 <= depth.bits
    if exact and depth.gain == 1.0 and depth.offset == 0.0:
        dn, below, above = values.astype(kind), 0, 0
    else:
        real = np.where(pixels.valid, values, 0) * float(depth.gain) + depth.offset
        rounded = np.rint(np.where(np.isfinite(real), real, 0))
        below = int(np.count_nonzero((rounded < 0) & pixels.valid))
        above = int(np.count_nonzero((rounded > depth.largest) & pixels.valid))
        dn = np.clip(rounded, 0, depth.largest).astype(kind)
    dn[pixels.missing | pixels.dark] = 0
    dn[pixels.saturated] = depth.largest
    missing, saturated = (int(np.count_nonzero(m)) for m in (pixels.missing, pixels.saturated))
    return StoredPixels(dn, depth, missing, saturated, below, above)
