"""Pixels of an image file: values, and which of them are no measurements."""

from __future__ import annotations

from dataclasses import dataclass

from spcola.arrays import AnyArray, BoolArray, FloatArray, check_shape
from spcola.errors import InvalidValueError


@dataclass(frozen=True, eq=False)
class PixelValues:
    """Brightness of pixels in a file's order, with its special values as masks.

    Parameters
    ----------
    values : (lines, samples) ndarray
        Brightness in the file's unit. Integers where the file gives integers; pixels in a mask
        have NaN, or in integers the number in the file.
    missing : (lines, samples) bool ndarray
        No data.
    dark : (lines, samples) bool ndarray
        Saturated at the low end.
    saturated : (lines, samples) bool ndarray
        Saturated at the high end.

    Raises
    ------
    InvalidValueError
        If `values` has not two axes, or a mask another shape.
    """

    values: AnyArray
    missing: BoolArray
    dark: BoolArray
    saturated: BoolArray

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.dtype.kind not in "uif":
            raise InvalidValueError(
                f"have shape {self.values.shape} and type {self.values.dtype}, lines × samples of "
                "numbers are needed",
                "pixels",
            )
        for name in ("missing", "dark", "saturated"):
            check_shape(getattr(self, name), self.values.shape, f"pixels.{name}")

    @property
    def valid(self) -> BoolArray:
        """Pixels (lines, samples) that are measurements."""
        valid: BoolArray = ~(self.missing | self.dark | self.saturated)
        return valid

    def with_values(self, values: FloatArray) -> PixelValues:
        """Return other values with the same masks."""
        return PixelValues(values, self.missing, self.dark, self.saturated)
