"""Special values of pixels: which stored numbers are no measurements."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera.detector import PixelValues
from spcola.errors import FormatError

_LARGEST = 1e30


@dataclass(frozen=True)
class SpecialValues:
    """Stored numbers with a meaning, before scaling.

    Parameters
    ----------
    missing, dark, saturated : tuple of float
        No data; saturated at the low and at the high end.
    lowest : float, optional
        Smaller numbers that are in none of the groups are missing too.
    highest : float, optional
        Level of saturation: numbers from there on are saturated.
    """

    missing: tuple[float, ...] = ()
    dark: tuple[float, ...] = ()
    saturated: tuple[float, ...] = ()
    lowest: float | None = None
    highest: float | None = None


def check_scaling(scale: float, base: float, path: Path) -> None:
    """Refuse a scaling that no brightness has.

    Raises
    ------
    FormatError
        If `scale` is 0, or a number is not finite or beyond 1e30.
    """
    if not (0 < abs(scale) < _LARGEST and abs(base) < _LARGEST):
        raise FormatError(f"has an impossible scaling (× {scale:g}, + {base:g})", path)


def classified(stored: AnyArray, special: SpecialValues, scale: float, base: float) -> PixelValues:
    """Return ``base + scale × stored`` with the special values as masks.

    Integers with scale 1 and base 0 remain integers; other values become float32 where they fit
    without loss (integers of 16 bits and fewer, float32), otherwise float64.
    """
    dark, saturated = (_among(stored, group) for group in (special.dark, special.saturated))
    missing = _among(stored, special.missing)
    if special.highest is not None:
        saturated |= stored >= special.highest
    if special.lowest is not None:
        missing |= (stored < special.lowest) & ~dark & ~saturated
    if stored.dtype.kind == "f":
        missing |= ~np.isfinite(stored)
    if scale == 1.0 and base == 0.0 and stored.dtype.kind in "ui":
        return PixelValues(stored, missing, dark, saturated)
    short = stored.dtype.itemsize <= 2 or stored.dtype == np.float32
    values: FloatArray = stored.astype(np.float32 if short else np.float64)
    none = missing | dark | saturated
    if none.any():
        values[none] = np.nan
    if scale != 1.0 or base != 0.0:
        with np.errstate(over="ignore"):
            values = (values * scale + base).astype(values.dtype)
        missing |= ~np.isfinite(values) & ~dark & ~saturated
    return PixelValues(values, missing, dark, saturated)


def _among(stored: AnyArray, numbers: tuple[float, ...]) -> BoolArray:
    """Return which pixels have one of `numbers`, compared in the pixels' own type."""
    found = np.zeros(stored.shape, dtype=bool)
    for number in numbers:
        if stored.dtype.kind in "ui":
            limits = np.iinfo(stored.dtype)
            if number != int(number) or not limits.min <= number <= limits.max:
                continue
        found |= stored == stored.dtype.type(number)
    return found
