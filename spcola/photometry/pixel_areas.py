"""Areas of ground in pixels: which share of each pixel of an image each cell of a grid covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.grids.gaps import carried_on
from spcola.photometry.ortho_image import View

# Rows and columns of pixels added around the ground.
_MARGIN = 2
# Smaller areas are rounding, pixels.
_LEAST = 1e-12


@dataclass(frozen=True, eq=False)
class PixelAreas:
    """Area of each cell of a grid in each pixel of a window of an image.

    A cell is the quadrilateral between four points of the grid as they are projected; its areas are
    exact. Ground that faces the camera fills more pixels than ground that turns away from it. Cells
    of which the camera sees less than half, and those that are folded over, have none.

    Parameters
    ----------
    first : (2,) ndarray of int
        Row and column, from 0, of the window's first pixel in the image.
    window : tuple of int
        Rows and columns of the window (H, W).
    cells : tuple of int
        Rows and columns of cells (R − 1, C − 1).
    start : (N + 1,) ndarray of int
        Where the areas of each cell, row by row, begin in `pixel` and `area`.
    pixel : (K,) ndarray of int
        Index of a pixel in the window, row by row.
    area : (K,) ndarray
        Area of the cell there, pixels.
    """

    first: IntArray
    window: tuple[int, int]
    cells: tuple[int, int]
    start: IntArray
    pixel: IntArray
    area: FloatArray

    @classmethod
    def of(cls, view: View) -> PixelAreas | None:
        """Return the areas of the ground of a view; None if the camera sees nothing of it."""
        if not view.seen.any():
            return None
        row, column, seen = _without_gaps(view)
        lines, pixels = row[seen > 0.0], column[seen > 0.0]
        first = np.floor([lines.min(), pixels.min()]).astype(np.int64) - _MARGIN
        last = np.ceil([lines.max(), pixels.max()]).astype(np.int64) + _MARGIN
        window = int(last[0] - first[0]) + 1, int(last[1] - first[1]) + 1
        # Lines run down, pixels right: a cell facing the camera has the sign of −∂(pixel, line).
        facing = -float(np.sign(np.linalg.det(view.footprint)))
        # Pixel k reaches from k − 1/2 to k + 1/2.
        places = row - first[0] + 0.5, column - first[1] + 0.5, seen
        count, rows, columns = _size(*places)
        start = np.zeros((row.shape[0] - 1) * (row.shape[1] - 1) + 1, dtype=np.int64)
        pixel, area = np.empty(count, dtype=np.int32), np.empty(count)
        buffer = np.zeros((rows + 1, columns + 2))
        used = _cover(places, facing, window, buffer, (start, pixel, area))
        cells = row.shape[0] - 1, row.shape[1] - 1
        return cls(first, window, cells, start, pixel[:used].copy(), area[:used].copy())

    def spread(self, values: FloatArray) -> FloatArray:
        """Return the sums (H, W) over cells of their area times their value (R − 1, C − 1)."""
        sums = np.zeros(self.window[0] * self.window[1])
        flat = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
        _spread(self.start, self.pixel, self.area, flat, sums)
        return sums.reshape(self.window)


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


@compiled_inline
def _box(layer: FloatArray, i: int, j: int) -> tuple[int, int]:
    """First pixel that a cell reaches along an axis, and how many."""
    a, b, c, d = layer[i, j], layer[i, j + 1], layer[i + 1, j], layer[i + 1, j + 1]
    first = int(np.floor(min(a, b, c, d)))
    return first, int(np.floor(max(a, b, c, d))) - first + 1


@compiled_inline
def _is_seen(seen: FloatArray, i: int, j: int) -> bool:
    return seen[i, j] + seen[i, j + 1] + seen[i + 1, j] + seen[i + 1, j + 1] >= 2.0


@compiled
def _size(row: FloatArray, column: FloatArray, seen: FloatArray) -> tuple[int, int, int]:
    """Return how many areas there are at most, and the most rows and columns of a cell."""
    count, rows, columns = 0, 1, 1
    for i in range(row.shape[0] - 1):
        for j in range(row.shape[1] - 1):
            if _is_seen(seen, i, j):
                high, wide = _box(row, i, j)[1], _box(column, i, j)[1]
                count += high * wide
                rows, columns = max(rows, high), max(columns, wide)
    return count, rows, columns


@compiled
def _cover(
    places: tuple[FloatArray, FloatArray, FloatArray],
    facing: float,
    window: tuple[int, int],
    buffer: FloatArray,
    areas: tuple[IntArray, IntArray, FloatArray],
) -> int:
    """Fill the `areas` (start, pixel, area) of all cells; return how many there are."""
    row, column, seen = places
    start, pixel, area = areas
    used, cell = 0, 0
    for i in range(row.shape[0] - 1):
        for j in range(row.shape[1] - 1):
            if _is_seen(seen, i, j):
                top, high = _box(row, i, j)
                left, wide = _box(column, i, j)
                _outline(buffer, row, column, i, j, top, left)
                for y in range(high):
                    # The running sum along a row is the area of the cell left of each border.
                    total = 0.0
                    for x in range(wide):
                        total += buffer[y, x]
                        inside = 0 <= top + y < window[0] and 0 <= left + x < window[1]
                        if inside and facing * total > _LEAST:
                            pixel[used] = (top + y) * window[1] + left + x
                            area[used] = facing * total
                            used += 1
                buffer[: high + 1, : wide + 2] = 0.0
            cell += 1
            start[cell] = used
    return used


@compiled
def _outline(
    buffer: FloatArray,
    row: FloatArray,
    column: FloatArray,
    i: int,
    j: int,
    top: int,
    left: int,
) -> None:
    """Add the four edges of a cell, whose first pixel is (top, left), to `buffer`."""
    for side in range(4):
        # Corners in their order around the cell: (0, 0), (0, 1), (1, 1), (1, 0).
        a, b = i + side // 2, j + (side == 1) + (side == 2)
        following = (side + 1) % 4
        c, d = i + following // 2, j + (following == 1) + (following == 2)
        _edge(buffer, row[a, b] - top, column[a, b] - left, row[c, d] - top, column[c, d] - left)


@compiled
def _edge(buffer: FloatArray, y0: float, x0: float, y1: float, x1: float) -> None:
    """Add an edge: in each row of pixels, the change along x of the area to its right.

    Areas are exact, as in the rasterisation of outlines with signed areas.
    """
    sign = 1.0
    if y0 > y1:
        y0, x0, y1, x1, sign = y1, x1, y0, x0, -1.0
    if y0 == y1:
        return
    slope = (x1 - x0) / (y1 - y0)
    for y in range(int(np.floor(y0)), int(np.ceil(y1))):
        above, below = max(float(y), y0), min(y + 1.0, y1)
        begin, end = x0 + slope * (above - y0), x0 + slope * (below - y0)
        # Rounding must not lead out of the cell's box.
        low, high = max(min(begin, end), 0.0), max(begin, end)
        _run(buffer[y], sign * (below - above), low, high)


@compiled
def _run(line: FloatArray, height: float, low: float, high: float) -> None:
    """Add a part of an edge that crosses one row of pixels from x = `low` to `high`."""
    first, last = int(np.floor(low)), int(np.floor(high))
    if first == last:
        right = 1.0 + first - 0.5 * (low + high)
        line[first] += height * right
        line[first + 1] += height * (1.0 - right)
        return
    # Mean over the edge of the part of each pixel to its right, and how much that grows.
    before = 0.0
    for x in range(first, last + 1):
        here, there = max(low, float(x)), min(high, x + 1.0)
        across = (there - here) * (1.0 + x - 0.5 * (here + there))
        covered = (here - low + across) / (high - low)
        line[x] += height * (covered - before)
        before = covered
    line[last + 1] += height * (1.0 - before)


@compiled
def _spread(
    start: IntArray, pixel: IntArray, area: FloatArray, values: FloatArray, sums: FloatArray
) -> None:
    for cell in range(len(values)):
        for k in range(start[cell], start[cell + 1]):
            sums[pixel[k]] += area[k] * values[cell]
