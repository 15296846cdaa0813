"""Pixels of an image of stars."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.formats.images import open_image


def read_star_image(path: str | Path, *, size: tuple[int, int]) -> FloatArray:
    """Return the pixels (H, W) of an image file of any format; its first row is line 1.

    Parameters
    ----------
    path : str or Path
    size : (2,) of int
        Width and height of the camera, for a .DAT file: it has no header.

    Returns
    -------
    ndarray
        NaN where the file marks pixels as missing or saturated.

    Raises
    ------
    FormatError
        If the format is unknown, or label and pixels contradict each other.
    """
    path = Path(path)
    pixels = open_image(path, size=size if path.suffix.upper() == ".DAT" else None).read()
    values: FloatArray = np.where(pixels.valid, pixels.values.astype(np.float64), np.nan)
    return values
