"""Intersection of a ray with the bilinear surface of a tile.

Whether a ray passes above a block of cells follows from the ends of its way over it and the block's
maximum (Tevs et al. 2008, "Maximum mipmaps for fast, accurate, and scalable dynamic height field
rendering", here on a sphere). The rest are single cells. A ray that enters a cell and leaves it
again through its saddle is assumed to pass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled
from spcola.truth.sampled.cube import Tiling
from spcola.truth.sampled.face_lines import Line, leaves, nearest

_MOST_REFINEMENTS = 60
_ON_SURFACE = 1e-9


class Cell(NamedTuple):
    """A cell on a face, with the radius ``radius + p·rise_u + q·rise_v + p·q·twist``.

    p and q run from 0 to 1 over the cell, which begins at `column` and `row`; `square` is the
    squared distance of the ray's foot from O.
    """

    column: int
    row: int
    radius: float
    rise_u: float
    rise_v: float
    twist: float
    square: float


@compiled
def _at_cell(line: Line, cell: Cell, t: float) -> float:
    """Return the height of a ray at t above the bilinear surface of a cell."""
    w = line.w0 + line.wd * t
    p = (line.x0 + line.xd * t) / w - cell.column
    q = (line.y0 + line.yd * t) / w - cell.row
    ground = cell.radius + p * cell.rise_u + q * (cell.rise_v + p * cell.twist)
    return np.sqrt(cell.square + t * t) - ground


@compiled
def _crossing(line: Line, cell: Cell, ends: tuple[float, float, float, float]) -> float:
    """Return the place where a ray crosses a cell's surface: regula falsi in the Illinois form."""
    above, f_above, below, f_below = ends
    last = 0
    for step in range(_MOST_REFINEMENTS):
        middle = 0.5 * (above + below)
        if step % 8 != 7:
            middle = above + (below - above) * f_above / (f_above - f_below)
        value = _at_cell(line, cell, middle)
        if abs(value) < _ON_SURFACE or below - above < _ON_SURFACE:
            return middle
        if value > 0.0:
            above, f_above = middle, value
            f_below *= 0.5 if last == 1 else 1.0
            last = 1
        else:
            below, f_below = middle, value
            f_above *= 0.5 if last == -1 else 1.0
            last = -1
    return 0.5 * (above + below)


@compiled
def _in_cell(
    tiling: Tiling,
    tile: tuple[FloatArray, int],
    line: Line,
    places: tuple[int, int, int, int],
    way: tuple[float, float, float],
) -> float:
    """Return the place where a ray hits the surface of a cell, NaN if it does not.

    `places` are the column and row of the cell in the tile and on the face; `way` the places where
    the ray enters and leaves, and its squared distance from O at the foot.
    """
    (pool, slot), (t, leave, square) = tile, way
    side = tiling.size + 3
    k = (places[1] + 1) * side + places[0] + 1
    h, hu = pool[slot, k], pool[slot, k + 1]
    hv, huv = pool[slot, k + side], pool[slot, k + side + 1]
    if nearest(square, t, leave) > (tiling.base + max(h, hu, hv, huv)) ** 2:
        return np.nan
    twist = np.float64(h) - hu - hv + huv
    cell = Cell(places[2], places[3], tiling.base + h, hu - h, hv - h, twist, square)
    above = _at_cell(line, cell, t)
    if above <= 0.0:
        return t
    below = _at_cell(line, cell, leave)
    return _crossing(line, cell, (t, above, leave, below)) if below <= 0.0 else np.nan


@compiled
def _beyond(
    line: Line,
    corner: tuple[int, int],
    block: tuple[int, int, int],
    way: tuple[float, bool],
) -> tuple[int, int]:
    """Return the column and row, in the tile, of the cell where a ray leaves a block.

    `block` is a column and row in it and its level, `way` the place where the ray leaves it and
    whether through a side of u. Whatever the rounding, the ray goes to a neighbour of the block.
    """
    (column, row, level), (t, through_u) = block, way
    i, j, size = column >> level, row >> level, 1 << level
    if through_u:
        column = (i + 1) * size if line.across > 0 else i * size - 1
        if level > 0:
            place = int((line.y0 + line.yd * t) / (line.w0 + line.wd * t)) - corner[1]
            row = min((j + 1) * size - 1, max(j * size, place))
    else:
        row = (j + 1) * size if line.along > 0 else j * size - 1
        if level > 0:
            place = int((line.x0 + line.xd * t) / (line.w0 + line.wd * t)) - corner[0]
            column = min((i + 1) * size - 1, max(i * size, place))
    return column, row


@compiled
def in_tile(
    tiling: Tiling,
    tile: tuple[FloatArray, int],
    line: Line,
    corner: tuple[int, int],
    way: tuple[float, float, float, float],
) -> float:
    """Return the place where a ray hits the surface of a tile: NaN for none, −∞ if from below.

    `tile` is the pool and the tile's row in it, `corner` the column and row, in cells, of its
    first node; `way` the places where the ray enters and leaves, its squared distance from O at
    the foot, and its beginning.
    """
    t, end, square, start = way
    (pool, slot), starts, size = tile, tiling.starts, tiling.size
    top = level = len(starts) - 1
    w = line.w0 + line.wd * t
    column = min(size - 1, max(0, int((line.x0 + line.xd * t) / w) - corner[0]))
    row = min(size - 1, max(0, int((line.y0 + line.yd * t) / w) - corner[1]))
    found = np.nan
    while min(column, row) >= 0 and max(column, row) < size and t < end and np.isnan(found):
        i, j, block = column >> level, row >> level, 1 << level
        leave, through_u = leaves(line, (corner[0] + i * block, corner[1] + j * block), block, t)
        leave = min(leave, end)
        if level > 0:
            most = pool[slot, starts[level] + j * (size >> level) + i]
            if nearest(square, t, leave) <= (tiling.base + most) ** 2:
                level -= 1
                continue
        else:
            places = (column, row, corner[0] + column, corner[1] + row)
            found = _in_cell(tiling, tile, line, places, (t, leave, square))
        column, row = _beyond(line, corner, (column, row, level), (leave, through_u))
        t = leave
        # Where the block above ends too, a larger one may be tried again.
        if column >> (level + 1) != i >> 1 or row >> (level + 1) != j >> 1:
            level = min(level + 1, top)
    # A ray that began below the ground hits nothing; elsewhere that is rounding at a border.
    return -np.inf if found == start else found
