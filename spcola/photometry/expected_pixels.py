"""Expected pixels of an image: the brightness of ground averaged over their footprints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.grids.gaps import carried_on
from spcola.photometry.image_blur import ImageBlur
from spcola.photometry.ortho_image import View
from spcola.photometry.pixel_areas import PixelAreas

# Share of a pixel that the grid has to fill.
_COVERED = 0.6
# Share of the filled area that must be known: gaps lie anywhere, the grid's edge to one side.
_KNOWN = 0.5


@dataclass(frozen=True, eq=False)
class ExpectedPixels:
    """Expected brightness in a window of an image.

    Attributes
    ----------
    value : (H, W) ndarray
        Mean brightness over each pixel; that of the nearest known one where `known` is False.
    known : (H, W) ndarray of bool
        Whether ground of known brightness fills the pixel.
    first : (2,) ndarray of int
        Row and column, from 0, of the window's first pixel in the image.
    """

    value: FloatArray
    known: BoolArray
    first: FloatArray


def expected_pixels(
    view: View, brightness: FloatArray, *, blur: ImageBlur | None = None
) -> ExpectedPixels:
    """Return the expected pixels of an image of ground.

    Each cell between four points of the grid contributes to a pixel by its area there
    (:class:`spcola.photometry.pixel_areas.PixelAreas`).

    Parameters
    ----------
    view : View
        Geometry of the image over the grid.
    brightness : (R − 1, C − 1) ndarray
        Brightness of each cell; NaN where unknown.
    blur : ImageBlur, optional
        Of the image; none if not given.
    """
    areas = PixelAreas.of(view)
    if areas is None:
        nothing = np.full((1, 1), np.nan)
        return ExpectedPixels(nothing, np.zeros((1, 1), dtype=np.bool_), np.zeros(2))
    bright = np.isfinite(brightness)
    layers = np.where(bright, brightness, 0.0), bright, np.ones(areas.cells)
    blur = blur or ImageBlur()
    light, area, whole = (blur.applied(areas.spread(layer), (0, 1)) for layer in layers)
    known: BoolArray = (whole >= _COVERED) & (area >= _KNOWN * whole)
    with np.errstate(invalid="ignore", divide="ignore"):
        value = carried_on(np.where(known, light / area, np.nan))
    return ExpectedPixels(value, known, areas.first.astype(np.float64))
