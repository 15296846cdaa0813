"""A cloud of points as a surface on a grid: sums by cell, smoothed with their counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.grids import MapletGrid
from spcola.math import Affine

# A smoothed height that rests on fewer points than this is not known.
_LEAST_SUPPORT = 0.5
# Standard deviations of the Gaussian at which it is cut off.
_CUT_OFF = 3.5


@dataclass(frozen=True, eq=False)
class CloudGrid:
    """Sums over the points in each cell of a grid.

    Attributes
    ----------
    sums : (4, N, N) ndarray
        Number of points, sum of heights (metres), sums of their distances from the grid point
        along x and y (metres).
    gsd : float
        Metres.
    dropped : int
        Points on the grid, too far from the expected surface.
    """

    sums: FloatArray
    gsd: float
    dropped: int

    @property
    def points(self) -> int:
        """Number of points that count."""
        return int(self.sums[0].sum())

    def surface(
        self, slope_x: FloatArray, slope_y: FloatArray, blur_cells: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return heights (N, N), metres, and how many points each rests on (N, N).

        Each point's height is carried to its grid point by the slopes given [36]; then heights
        are averaged under a Gaussian of `blur_cells`, all points counting alike. NaN where there
        are none.
        """
        heights = self.sums[1] - slope_x * self.sums[2] - slope_y * self.sums[3]
        count, total = _smooth(self.sums[0], blur_cells), _smooth(heights, blur_cells)
        # A Gaussian weighs points unequally: it is worth as many as fill its area.
        worth = count * max(4.0 * np.pi * blur_cells**2, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            height = np.where(worth >= _LEAST_SUPPORT, total / count, np.nan)
        return height, worth


def grid_cloud(
    points: FloatArray,
    grid: MapletGrid,
    transform: Affine,
    *,
    expected: FloatArray | None = None,
    limit_m: float = np.inf,
) -> CloudGrid:
    """Sum up a cloud over the cells of a grid.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres.
    grid : MapletGrid
    transform : Affine
        From the frame of the points to that of the grid.
    expected : (2q+1, 2q+1) ndarray, optional
        Heights; points further than `limit_m` from them are dropped.
    limit_m : float
        Metres.
    """
    sums = np.zeros((4, *grid.shape))
    matrix = grid.axes @ transform.matrix
    offset = grid.axes @ (transform.translation - grid.center)
    surface = np.zeros((1, 1)) if expected is None else expected
    dropped = _sum_up(points, matrix, offset, grid.gsd, surface, limit_m, sums)
    return CloudGrid(sums, grid.gsd, dropped)


@compiled
def _sum_up(
    points: FloatArray,
    matrix: FloatArray,
    offset: FloatArray,
    gsd: float,
    expected: FloatArray,
    limit: float,
    sums: FloatArray,
) -> int:
    """Add each point to the sums of its cell; return how many lay too far from `expected`."""
    size, dropped = sums.shape[1], 0
    half, checked = (size - 1) // 2, expected.shape[0] == sums.shape[1]
    for k in range(len(points)):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        x = matrix[0, 0] * a + matrix[0, 1] * b + matrix[0, 2] * c + offset[0]
        y = matrix[1, 0] * a + matrix[1, 1] * b + matrix[1, 2] * c + offset[1]
        z = matrix[2, 0] * a + matrix[2, 1] * b + matrix[2, 2] * c + offset[2]
        column, row = int(np.floor(x / gsd + 0.5)) + half, int(np.floor(y / gsd + 0.5)) + half
        if not (0 <= column < size and 0 <= row < size):
            continue
        if checked and abs(z - expected[row, column]) > limit:
            dropped += 1
            continue
        sums[0, row, column] += 1.0
        sums[1, row, column] += z
        sums[2, row, column] += x - (column - half) * gsd
        sums[3, row, column] += y - (row - half) * gsd
    return dropped


def _smooth(layer: FloatArray, sigma_cells: float) -> FloatArray:
    if sigma_cells <= 0:
        return layer
    smoothed: FloatArray = ndimage.gaussian_filter(
        layer, sigma_cells, mode="constant", truncate=_CUT_OFF
    )
    return smoothed
