"""Where the pixels of an image lie in its file, and how a window of them is read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from spcola.arrays import AnyArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.images.dat import bytes_per_pixel, read_image_data, smoother_when_swapped
from spcola.formats.images.fits import reading_fits
from spcola.formats.images.isis_label import reading_raster
from spcola.formats.text import regular_size

Window = tuple[slice, slice]

# Pixels of images are within these sizes; what is outside was read in the wrong byte order.
_LEAST, _MOST = 1e-30, 1e30
_CONTRADICTION = 0.1
_FEWEST_TO_JUDGE = 256


def chosen_band(path: Path, band: int | None, count: int) -> int:
    """Return the band to read, from 1: the one asked for, or the only one.

    Raises
    ------
    FormatError
        If there are several, and none was asked for.
    InvalidValueError
        If it does not exist.
    """
    if band is None and count != 1:
        raise FormatError(f"has {count} bands", path, "write one of them into a file of its own")
    if band is not None and not 1 <= band <= count:
        raise InvalidValueError(f"has no band {band} (it has {count})", path)
    return band or 1


class PixelSource(Protocol):
    """Pixels of one image in a file."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    def read(self, window: Window) -> AnyArray:
        """Return stored numbers (lines, samples) of a window, in this machine's byte order."""
        ...


@dataclass(frozen=True)
class PlainArray:
    """An uncompressed array at a place of a file (PDS3 and PDS4 images).

    Parameters
    ----------
    path : Path
    offset : int
        Bytes before the first line.
    dtype : numpy.dtype
        Of a pixel, with its byte order.
    lines, samples : int
    before, after : int
        Bytes before and after the pixels of each line.

    Raises
    ------
    FormatError
        If the file is shorter than the array.
    """

    path: Path
    offset: int
    dtype: np.dtype[np.generic]
    lines: int
    samples: int
    before: int = 0
    after: int = 0

    def __post_init__(self) -> None:
        try:
            length = regular_size(self.path)
        except OSError as error:
            raise FormatError(f"cannot be read ({error.strerror or error})", self.path) from error
        needed = self.offset + self.lines * self._line_bytes
        if length < needed:
            raise FormatError(
                f"has {length} bytes, its label needs {needed} ({self.lines} × {self.samples} "
                f"pixels of {self.dtype.itemsize} bytes from byte {self.offset + 1})",
                self.path,
                "the file is truncated, or the label is another image's",
            )

    def following(self, number: int) -> PlainArray:
        """Return the array that lies `number` arrays of this size further on."""
        offset = self.offset + number * self.lines * self._line_bytes
        return replace(self, offset=offset) if number else self

    @property
    def _line_bytes(self) -> int:
        return self.before + self.samples * self.dtype.itemsize + self.after

    def read(self, window: Window) -> AnyArray:
        """Return stored numbers of a window.

        Raises
        ------
        FormatError
            If the file cannot be read, or the pixels contradict the stated byte order.
        """
        first, last, _ = window[0].indices(self.lines)
        try:
            with self.path.open("rb") as stream:
                stream.seek(self.offset + first * self._line_bytes)
                content = stream.read((last - first) * self._line_bytes)
        except OSError as error:
            raise FormatError(f"cannot be read ({error.strerror or error})", self.path) from error
        rows = np.frombuffer(content, np.uint8).reshape(last - first, self._line_bytes)
        pixels = rows[:, self.before : self._line_bytes - self.after]
        stored = np.ascontiguousarray(pixels).view(self.dtype)[:, window[1]]
        native = stored.astype(stored.dtype.newbyteorder("="))
        _check_byte_order(native, self.path)
        return native


@dataclass(frozen=True)
class RasterBand:
    """A band that GDAL reads (ISIS cubes, TIFF, PNG).

    Parameters
    ----------
    path : Path
    driver : str
        GDAL's name of the format.
    band : int
        From 1.
    equal : tuple of int
        Bands that must be the same: grey stored as colour.
    """

    path: Path
    driver: str
    band: int = 1
    equal: tuple[int, ...] = ()

    def read(self, window: Window) -> AnyArray:
        """Return stored numbers of a window.

        Raises
        ------
        FormatError
            If the file cannot be read, or its colours differ.
        """
        rows, columns = ((part.start, part.stop) for part in window)
        bands = (self.band, *self.equal)
        with reading_raster(self.path, self.driver) as dataset:
            stored: AnyArray = dataset.read(bands, window=(rows, columns))
        if any(np.any(other != stored[0]) for other in stored[1:]):
            raise FormatError("is in colour", self.path, "convert it to grey")
        return stored[0]


@dataclass(frozen=True)
class FitsUnit:
    """An image in a FITS file, before BSCALE and BZERO.

    Parameters
    ----------
    path : Path
    unit : int
        0 for the primary array.
    plane : tuple of int
        Place along the axes beyond two, from 0.
    unsigned : bool
        Whether integers are stored less half their range (BZERO of 32768, for 16 bits); they are
        returned without sign.
    """

    path: Path
    unit: int = 0
    plane: tuple[int, ...] = ()
    unsigned: bool = False

    def read(self, window: Window) -> AnyArray:
        """Return numbers of a window.

        Raises
        ------
        FormatError
            If the file cannot be read.
        """
        with reading_fits(self.path, scaled=False) as units:
            values = np.asarray(units[self.unit].section[self.plane + window])
        values = values.astype(values.dtype.newbyteorder("="))
        if not self.unsigned:
            return values
        kind = np.dtype(f"u{values.dtype.itemsize}")
        return values.view(kind) ^ kind.type(1 << (8 * kind.itemsize - 1))


@dataclass(frozen=True)
class DatFile:
    """An SPC .DAT file.

    Parameters
    ----------
    path : Path
    width, height : int

    Raises
    ------
    FormatError
        If its length is not that of one or two bytes a pixel.
    """

    path: Path
    width: int
    height: int

    def __post_init__(self) -> None:
        bytes_per_pixel(regular_size(self.path), self.width, self.height, self.path)

    @property
    def dtype(self) -> np.dtype[np.generic]:
        """Type of a pixel; the byte order is found when pixels are read."""
        length = regular_size(self.path)
        return np.dtype(f"u{bytes_per_pixel(length, self.width, self.height, self.path)}")

    def read(self, window: Window) -> AnyArray:
        """Return stored numbers of a window.

        Raises
        ------
        FormatError
            If the file cannot be read.
        """
        return read_image_data(self.path, self.width, self.height)[window]


def _check_byte_order(stored: AnyArray, path: Path) -> None:
    """Refuse pixels whose other byte order is the plausible one.

    For 16 bits by the smoothness of the image, as for .DAT files; for floating point by the size
    of the numbers.
    """
    if stored.size < _FEWEST_TO_JUDGE or stored.dtype.itemsize == 1:
        return
    swapped = stored.byteswap()
    if stored.dtype.itemsize == 2:
        # Numbers of one byte moved up by eight bits are smoother in the wrong order.
        varied = np.any((stored & 255) != (stored[0, 0] & 255))
        wrong = bool(varied) and smoother_when_swapped(stored.view(np.uint16))
    elif stored.dtype.kind == "f":
        wrong = _implausible(stored) > _CONTRADICTION > 2 * _implausible(swapped)
    else:
        size = [float(np.mean(np.abs(part.astype(np.float64)))) for part in (stored, swapped)]
        wrong = size[0] > 1e3 * size[1]
    if wrong:
        raise FormatError(
            "has pixels that contradict the byte order in its label (they are plausible in the "
            "other one)",
            path,
            "correct the label's sample type, or exchange the bytes",
        )


def _implausible(values: AnyArray) -> float:
    """Share of floating-point numbers that are no brightness."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        plausible = (values == 0) | ((size > _LEAST) & (size < _MOST))
    return 1.0 - float(np.count_nonzero(plausible)) / values.size
