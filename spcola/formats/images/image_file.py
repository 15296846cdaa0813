"""One door to image files: what they contain and state, and their pixels when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from spcola.camera.detector import PixelValues
from spcola.errors import InvalidValueError
from spcola.formats.images.image_label import ImageLabel
from spcola.formats.images.pixel_sources import PixelSource
from spcola.formats.images.special_values import SpecialValues, classified


class ImageFormat(StrEnum):
    """Format of a file of pixels or of a label."""

    FITS = "fits"
    PDS3 = "pds3"
    PDS4 = "pds4"
    ISIS = "isis"
    TIFF = "tiff"
    PNG = "png"
    DAT = "dat"


@dataclass(frozen=True, eq=False)
class ImageFile:
    """An image file; nothing of its pixels is kept in memory.

    Parameters
    ----------
    path : Path
        The file that was opened.
    format : ImageFormat
        Of the label, or of the file if it has none.
    pixel_path : Path
        The file with the pixels.
    label_path : Path, optional
        The file with the label, which may be the same; None for TIFF, PNG and .DAT.
    width, height : int
        Samples and lines.
    stored : numpy.dtype
        Type of a pixel in the file, with its byte order.
    source : PixelSource
    special : SpecialValues
        Stored numbers that are no measurements.
    scale, base : float
        ``brightness = base + scale × stored``.
    label : ImageLabel
    alpha : PixelSource, optional
        Band in which 0 marks missing pixels.
    notes : tuple of str
        What is doubtful, one sentence each.
    """

    path: Path
    format: ImageFormat
    pixel_path: Path
    label_path: Path | None
    width: int
    height: int
    stored: np.dtype[np.generic]
    source: PixelSource
    special: SpecialValues
    scale: float
    base: float
    label: ImageLabel
    alpha: PixelSource | None = None
    notes: tuple[str, ...] = ()

    @property
    def bits(self) -> int:
        """Bits of a stored pixel."""
        return 8 * self.stored.itemsize

    @property
    def byte_order(self) -> str:
        """``>`` (most significant byte first), ``<``, or an empty text where there is none."""
        if self.stored.itemsize == 1:
            return ""
        return ">" if self.stored.str[0] == ">" else "<"

    @property
    def name(self) -> str:
        """Name of the product, or of the file."""
        return self.label.name or self.path.name

    @property
    def described(self) -> str:
        """What is read, on one line."""
        label = "no label" if self.label_path is None else f"label {self.label_path.name}"
        return (
            f"{self.width} × {self.height} pixels of {self.bits} bits from {self.pixel_path.name}, "
            f"{label} ({self.format})"
        )

    def read(self, *, lines: slice | None = None, samples: slice | None = None) -> PixelValues:
        """Read the pixels, or a window of them.

        Parameters
        ----------
        lines, samples : slice, optional
            Rows and columns of the file, from 0, without a step; all if not given.

        Returns
        -------
        PixelValues
            In the file's order: the first row is line 1.

        Raises
        ------
        FormatError
            If the file cannot be read, or its pixels contradict its label.
        InvalidValueError
            If the window is empty or beyond the image.
        """
        window = (_within(lines, self.height, "lines"), _within(samples, self.width, "samples"))
        pixels = classified(self.source.read(window), self.special, self.scale, self.base)
        if self.alpha is None:
            return pixels
        missing = pixels.missing | (self.alpha.read(window) == 0)
        return PixelValues(pixels.values, missing, pixels.dark, pixels.saturated)


def _within(window: slice | None, length: int, name: str) -> slice:
    """Return a slice with both ends, checked."""
    first, last = (0, length) if window is None else (window.start or 0, window.stop)
    last = length if last is None else last
    if (window is not None and window.step not in (None, 1)) or not 0 <= first < last <= length:
        raise InvalidValueError(f"{window} is no window of {length} {name}", name)
    return slice(first, last)
