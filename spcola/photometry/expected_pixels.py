"""Expected pixels of an image: the brightness of ground averaged over their footprints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled
from spcola.grids.gaps import carried_on
from spcola.photometry.ortho_image import View

# Rows and columns of pixels added around the ground.
_MARGIN = 2
# Parts into which a cell is divided: at least, per pixel's width, and at most.
_PER_PIXEL, _LEAST, _MOST = 4.0, 3, 64
# Share of a pixel that the grid has to fill; less than 1, since parts of cells are discrete.
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


def expected_pixels(view: View, brightness: FloatArray, *, psf_px: float = 0.0) -> ExpectedPixels:
    """Return the expected pixels of an image of ground.

    Each cell between four points of the grid is divided into parts at bilinear places. A part
    contributes to its pixel by its area *in the image*: ground that faces the camera fills more
    pixels than ground that turns away from it.

    Parameters
    ----------
    view : View
        Geometry of the image over the grid.
    brightness : (R − 1, C − 1) ndarray
        Brightness of each cell; NaN where unknown.
    psf_px : float
        Standard deviation of the optics' point spread, pixels.
    """
    if not view.seen.any():
        nothing = np.full((1, 1), np.nan)
        return ExpectedPixels(nothing, np.zeros((1, 1), dtype=np.bool_), np.zeros(2))
    row, column, seen = _without_gaps(view)
    lines, pixels = row[seen > 0.0], column[seen > 0.0]
    first = np.floor([lines.min(), pixels.min()]) - _MARGIN
    size = np.ceil([lines.max(), pixels.max()]) + _MARGIN + 1.0 - first
    light, area, whole = np.zeros((3, *size.astype(np.int64)))
    # Lines run down, pixels right: a cell that faces the camera has the sign of −∂(pixel, line).
    facing = -float(np.sign(np.linalg.det(view.footprint)))
    places = row - first[0], column - first[1], seen
    _gather(places, brightness, facing, (light, area, whole))
    if psf_px > 0.0:
        light, area, whole = (
            ndimage.gaussian_filter(sums, psf_px) for sums in (light, area, whole)
        )
    known: BoolArray = (whole >= _COVERED) & (area >= _KNOWN * whole)
    with np.errstate(invalid="ignore", divide="ignore"):
        value = carried_on(np.where(known, light / area, np.nan))
    return ExpectedPixels(value, known, first)


def _without_gaps(view: View) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rows, columns (from 0) and visibility of all points (R, C) of a grid.

    Points of unknown height are placed relative to the nearest known one as on the grid's plane.
    """
    y, x = np.indices(view.seen.shape).astype(np.float64)
    plane = np.einsum("ab,brc->arc", view.footprint, np.stack([x, y]))
    column, row = (
        carried_on(place - flat) + flat - 1.0
        for place, flat in zip((view.pixel, view.line), plane, strict=True)
    )
    seen = carried_on(np.where(np.isfinite(view.pixel), view.seen, np.nan))
    return row, column, seen


@compiled
def _gather(
    places: tuple[FloatArray, FloatArray, FloatArray],
    brightness: FloatArray,
    facing: float,
    sums: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Add up the contributions to each pixel of a window.

    `places` (R, C) are rows and columns of points of the grid, and their visibility; `facing` is
    the sign of the area of a cell that faces the camera; `sums` are those of brightness times area,
    of area with known brightness, and of all area.
    """
    row, column, seen = places
    light, area, whole = sums
    for i in range(brightness.shape[0]):
        for j in range(brightness.shape[1]):
            a, b, c, d = _bilinear(row, i, j)
            e, f, g, h = _bilinear(column, i, j)
            p, q, r, s = _bilinear(seen, i, j)
            if max(p, p + q, p + r, p + q + r + s) <= 0.0:
                continue
            wide = max(
                np.hypot(b, f), np.hypot(c, g), np.hypot(b + d, f + h), np.hypot(c + d, g + h)
            )
            parts = min(max(int(np.ceil(_PER_PIXEL * wide)), _LEAST), _MOST)
            for part in range(parts**2):
                x, y = (part % parts + 0.5) / parts, (part // parts + 0.5) / parts
                turned = (b + d * y) * (g + h * x) - (c + d * x) * (f + h * y)
                share = facing * turned / parts**2
                down = int(np.rint(a + b * x + c * y + d * x * y))
                aside = int(np.rint(e + f * x + g * y + h * x * y))
                inside = 0 <= down < light.shape[0] and 0 <= aside < light.shape[1]
                if inside and share > 0.0 and p + q * x + r * y + s * x * y >= 0.5:
                    whole[down, aside] += share
                    if np.isfinite(brightness[i, j]):
                        area[down, aside] += share
                        light[down, aside] += share * brightness[i, j]


@compiled
def _bilinear(layer: FloatArray, i: int, j: int) -> tuple[float, float, float, float]:
    """Coefficients of 1, x, y and xy of a layer in the cell above row i, right of column j."""
    start, ahead, above = layer[i, j], layer[i, j + 1], layer[i + 1, j]
    return start, ahead - start, above - start, layer[i + 1, j + 1] - ahead - above + start
