"""Pixels of an image of stars."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.images import reading_fits


def read_star_image(path: str | Path) -> FloatArray:
    """Return the pixels (H, W) of the first image in a FITS file; its first row is line 1.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    FormatError
        If it is not FITS, is cut off, or has no image with two axes.
    """
    with reading_fits(path) as units:
        arrays = [np.array(unit.data, dtype=np.float64) for unit in units if unit.data is not None]
    images = [array for array in arrays if array.ndim == 2]
    if not images:
        raise FormatError("has no image with two axes", path)
    return images[0]
