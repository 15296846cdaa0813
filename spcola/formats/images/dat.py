"""Image data, .DAT: brightness of every pixel, one or two bytes each, without a header."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray
from spcola.compilation import compiled, compiled_inline
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.text.source import read_bytes

ByteOrder = Literal[">", "<"]


def read_image_data(
    path: str | Path, width: int, height: int, *, byte_order: ByteOrder | None = None
) -> AnyArray:
    """Read the pixels of an image whose size is in its .SUM file.

    Parameters
    ----------
    path : str or Path
        The file.
    width, height : int
        NPX and NLN.
    byte_order : {">", "<"}, optional
        Byte order of 16-bit data. If not given, the one in which neighbours are similar: in the
        wrong order the least significant byte leads, and neighbours differ like noise. SPC's own,
        most significant byte first, unless the other makes the sum of differences between
        neighbours less than half as large.

    Returns
    -------
    (NLN, NPX) ndarray of uint8 or uint16
        The first line of the file is the first row.

    Raises
    ------
    FormatError
        If the length fits neither one nor two bytes a pixel.
    """
    content = read_bytes(path)
    width_bytes = bytes_per_pixel(len(content), width, height, path)
    if width_bytes == 1:
        return np.frombuffer(content, np.uint8).reshape(height, width).copy()
    order = byte_order or _order_of(content, width, height)
    raw = np.frombuffer(content, np.dtype(np.uint16).newbyteorder(order))
    return raw.reshape(height, width).astype(np.uint16)


def write_image_data(path: str | Path, pixels: AnyArray, *, byte_order: ByteOrder = ">") -> None:
    """Write pixels (NLN, NPX), uint8 or uint16, as a .DAT file.

    Parameters
    ----------
    path : str or Path
    pixels : (NLN, NPX) ndarray
        Brightness, uint8 or uint16.
    byte_order : {">", "<"}
        Of 16-bit values: big-endian or little-endian.

    Raises
    ------
    InvalidValueError
        If they are of another type or shape.
    WorkspaceError
        If the file cannot be written.
    """
    pixels = np.asarray(pixels)
    if pixels.ndim != 2 or pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        raise InvalidValueError(
            f"pixels are {pixels.dtype} of shape {pixels.shape}, (NLN, NPX) of uint8 or uint16 "
            "are needed",
            path,
        )
    atomic.write_bytes(path, pixels.astype(pixels.dtype.newbyteorder(byte_order)).tobytes())


def bytes_per_pixel(length: int, width: int, height: int, path: str | Path) -> int:
    """Return 1 or 2, or refuse the file's length in bytes."""
    for count in (1, 2):
        if length == count * width * height:
            return count
    raise FormatError(
        f"has {length} bytes, {width} × {height} pixels need {width * height} or twice that",
        path,
        "it is truncated, or NPX and NLN are another image's",
    )


def smoother_when_swapped(pixels: AnyArray) -> bool:
    """Return whether 16-bit pixels (R, C) have much more similar neighbours with bytes exchanged.

    More similar: their differences sum up to less than half.
    """
    kept, swapped = _roughness(pixels)
    return bool(swapped < 0.5 * kept)


def _order_of(content: bytes, width: int, height: int) -> ByteOrder:
    """Return the byte order of 16-bit `content`."""
    read = np.frombuffer(content, "<u2").reshape(height, width).astype(np.uint16, copy=False)
    last, first = _roughness(read)
    return "<" if last < 0.5 * first else ">"


@compiled
def _roughness(pixels: AnyArray) -> tuple[np.int64, np.int64]:
    """Sums of absolute differences between neighbours along lines and columns of pixels (R, C).

    With the bytes of each pixel unchanged and exchanged. Compiled, and row by row so that it is
    vectorised: images are read by the thousand, and this reads all pixels.
    """
    rows, columns = pixels.shape
    kept, swapped = np.int64(0), np.int64(0)
    for r in range(rows):
        here, above = pixels[r], pixels[max(r - 1, 0)]
        for c in range(1, columns):
            a, b = np.int32(here[c]), np.int32(here[c - 1])
            kept += abs(a - b)
            swapped += abs(_exchanged(a) - _exchanged(b))
        for c in range(columns):
            a, b = np.int32(here[c]), np.int32(above[c])
            kept += abs(a - b)
            swapped += abs(_exchanged(a) - _exchanged(b))
    return kept, swapped


@compiled_inline
def _exchanged(pixel: np.int32) -> np.int32:
    return (pixel & 255) << 8 | pixel >> 8
