"""TIFF and PNG images: layout, as GDAL gives it. They have no label."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.errors import FormatError
from spcola.formats.images.isis_label import reading_raster
from spcola.formats.images.special_values import SpecialValues


@dataclass(frozen=True)
class RasterLayout:
    """Layout of a raster file.

    Parameters
    ----------
    width, height : int
    dtype : numpy.dtype
    grey : tuple of int
        Bands of brightness, from 1; several ones are colours.
    alpha : int, optional
        Band in which 0 marks missing pixels.
    scale, base : float
        ``brightness = base + scale × stored``.
    special : SpecialValues
    """

    width: int
    height: int
    dtype: np.dtype[np.generic]
    grey: tuple[int, ...]
    alpha: int | None
    scale: float
    base: float
    special: SpecialValues


def read_raster_layout(path: Path, driver: str) -> RasterLayout:
    """Return the layout of a TIFF or PNG.

    Raises
    ------
    FormatError
        If it cannot be read, has a colour table, or pixels that are no real numbers.
    """
    with reading_raster(path, driver) as dataset:
        names = [color.name for color in dataset.colorinterp]
        width, height, types = dataset.width, dataset.height, set(dataset.dtypes)
        scale, base, nodata = dataset.scales[0], dataset.offsets[0], dataset.nodata
    if "palette" in names:
        raise FormatError("has a colour table instead of brightness", path, "convert it to grey")
    kind = np.dtype(types.pop()) if len(types) == 1 else None
    if kind is None or kind.kind not in "uif":
        raise FormatError("has pixels that are no real numbers of one type", path)
    alpha = names.index("alpha") + 1 if "alpha" in names else None
    grey = tuple(band for band in range(1, len(names) + 1) if band != alpha)
    special = SpecialValues() if nodata is None else SpecialValues((float(nodata),))
    return RasterLayout(width, height, kind, grey, alpha, float(scale), float(base), special)
