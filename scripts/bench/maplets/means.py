"""Means of layers of maplets, and of the truth, over cells and pixels."""

from __future__ import annotations

import numpy as np

from spcola.grids import MapletGrid
from spcola.math import Similarity
from spcola.photometry.ground import Ground
from spcola.truth.body import TruthBody
from spcola.truth.solution import heights_in_frame

# Points at the edges of maplets that are not compared: their slopes are one-sided.
EDGE = 4
# Samples along the side of a cell whose mean is taken.
FINE = 3


def mean_heights(body: TruthBody, grid: MapletGrid, similarity: Similarity) -> np.ndarray:
    """Return the mean true heights (R, C) over squares of one GSD about the points of a grid."""
    return over_cells(heights_in_frame(body, fine_grid(grid), similarity))


def mean_albedo(body: TruthBody, grid: MapletGrid, similarity: Similarity) -> np.ndarray:
    """Return the mean true albedo (R, C) over squares of one GSD about the points of a grid."""
    fine = fine_grid(grid)
    ground = Ground.of(fine, heights_in_frame(body, fine, similarity))
    return over_cells(albedo_of(body, ground, similarity))


def albedo_of(body: TruthBody, ground: Ground, similarity: Similarity) -> np.ndarray:
    """Return the true albedo (R, C) at the points of some ground."""
    places = similarity.inverse().apply(ground.points.reshape(-1, 3))
    return body.albedo(places).reshape(ground.points.shape[:2])


def fine_grid(grid: MapletGrid) -> MapletGrid:
    """Return a grid with 3 x 3 points in the square of one GSD about each point of another."""
    half = FINE * grid.half_size + FINE // 2
    return MapletGrid(grid.center, grid.axes, grid.gsd / FINE, half)


def over_cells(layer: np.ndarray) -> np.ndarray:
    """Return the means (R, C) of a layer (3 R, 3 C) of such a grid."""
    rows, columns = (size // FINE for size in layer.shape)
    return layer.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))


def pixel_side(gsd: float, pixel: float) -> int:
    """Return the side of a pixel in whole cells."""
    return max(1, round(pixel / gsd))


def over_pixels(layer: np.ndarray, gsd: float, pixel: float) -> np.ndarray:
    """Return the means over a pixel of a layer (R, C), without its edges; NaN with unknown ones."""
    side, inner = pixel_side(gsd, pixel), layer[EDGE:-EDGE, EDGE:-EDGE]
    rows, columns = (size // side for size in inner.shape)
    squares = inner[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return squares.mean(axis=(1, 3))
