"""Rays over the tiles of a cube: which tiles they may need, and what they hit.

On a face a ray is a straight line, and along it the distance from O is least at the ray's foot
and grows to both sides. So whether a ray stays above all of a tile, or of a block of cells, is
told by the ends of its way over it and the block's maximum (Tevs et al. 2008, "Maximum mipmaps
for fast, accurate, and scalable dynamic height field rendering", here on a sphere). What is left
are single cells, where the crossing with the bilinear surface is found. A ray that dips into a
cell and comes out again through its saddle is taken to pass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.kernel import kernel
from spcola.truth.borrowing import borrowed
from spcola.truth.cube import Tiling, face_axes, face_of, place_of, tile_of, value_in

Vector = tuple[float, float, float]

_MOST_REFINEMENTS = 60
_ON_SURFACE = 1e-9


class Tiles(NamedTuple):
    """The tiles as the kernels take them; see :class:`spcola.truth.tilestore.TileStore`.

    `floor` and `ceiling` are radii between which the surface lies.
    """

    tiling: Tiling
    slots: IntArray
    pool: FloatArray
    lower: FloatArray
    upper: FloatArray
    floor: float
    ceiling: float


class Line(NamedTuple):
    """A ray on a face: w = w0 + t·wd, and u, v in cells are (x0 + t·xd)/w, (y0 + t·yd)/w.

    `across` and `along` tell which way u and v go: 1, −1, or 0 for not at all.
    """

    w0: float
    wd: float
    x0: float
    xd: float
    y0: float
    yd: float
    across: int
    along: int


class Cell(NamedTuple):
    """A cell on a face, of which the radius is ``radius + p·rise_u + q·rise_v + p·q·twist``.

    p and q run from 0 to 1 over the cell, which begins at `column` and `row`; `square` is that of
    the distance of the foot of the ray from O.
    """

    column: int
    row: int
    radius: float
    rise_u: float
    rise_v: float
    twist: float
    square: float


@kernel
def at(start: Vector, beam: Vector, t: float) -> Vector:
    """Return the point at t along a ray."""
    return start[0] + t * beam[0], start[1] + t * beam[1], start[2] + t * beam[2]


@kernel
def line_on(tiling: Tiling, face: int, foot: Vector, beam: Vector) -> Line:
    """Return a ray, as foot and unit vector, on a face."""
    a, b, c, sign = face_axes(face)
    half = 0.5 * tiling.across * tiling.size
    w0, wd = sign * foot[a], sign * beam[a]
    x0, xd = half * (w0 + foot[b]), half * (wd + beam[b])
    y0, yd = half * (w0 + foot[c]), half * (wd + beam[c])
    turn_x, turn_y = xd * w0 - x0 * wd, yd * w0 - y0 * wd
    across = 1 if turn_x > 0.0 else (-1 if turn_x < 0.0 else 0)
    along = 1 if turn_y > 0.0 else (-1 if turn_y < 0.0 else 0)
    return Line(w0, wd, x0, xd, y0, yd, across, along)


@kernel
def _meets(start: float, rate: float, line: Line, border: int, t: float) -> float:
    """Return where a coordinate reaches `border`, t at least; infinity if it never does."""
    slope = rate - border * line.wd
    if slope == 0.0:
        return np.inf
    at = (border * line.w0 - start) / slope
    # On the far side of the pole of the projection the line belongs to the opposite face.
    if not line.w0 + line.wd * at > 0.0:
        return np.inf
    return max(at, t)


@kernel
def _leaves(line: Line, first: tuple[int, int], size: int, t: float) -> tuple[float, bool]:
    """Return where a ray leaves a square of cells, and whether through a side of u.

    `first` is the column and row of its first cell on the face, `size` its side in cells.
    """
    across, along = np.inf, np.inf
    if line.across != 0:
        border = first[0] + size if line.across > 0 else first[0]
        across = _meets(line.x0, line.xd, line, border, t)
    if line.along != 0:
        border = first[1] + size if line.along > 0 else first[1]
        along = _meets(line.y0, line.yd, line, border, t)
    return (across, True) if across <= along else (along, False)


@kernel
def _square_of(line: Line, t: float, size: int, count: int) -> tuple[int, int]:
    """Return the column and row, of squares of `size` cells, at t."""
    w = line.w0 + line.wd * t
    # Sizes are powers of two, and the division of integers is slow.
    column = int((line.x0 + line.xd * t) / w / size)
    row = int((line.y0 + line.yd * t) / w / size)
    return min(count - 1, max(0, column)), min(count - 1, max(0, row))


@kernel
def _next_face(face: int, line: Line, through_u: bool) -> int:
    """Return the face behind the side through which a ray leaves `face`."""
    _, b, c, _ = face_axes(face)
    if through_u:
        return 2 * b + (line.across < 0)
    return 2 * c + (line.along < 0)


@kernel
def _nearest(square: float, t: float, end: float) -> float:
    """Return the least squared distance from O between t and `end`, both from the foot."""
    if t > 0.0:
        return square + t * t
    return square + end * end if end < 0.0 else square


@kernel
def _at_cell(line: Line, cell: Cell, t: float) -> float:
    """Return the height of a ray at t above the bilinear surface of a cell."""
    w = line.w0 + line.wd * t
    p = (line.x0 + line.xd * t) / w - cell.column
    q = (line.y0 + line.yd * t) / w - cell.row
    ground = cell.radius + p * cell.rise_u + q * (cell.rise_v + p * cell.twist)
    return np.sqrt(cell.square + t * t) - ground


@kernel
def _crossing(line: Line, cell: Cell, ends: tuple[float, float, float, float]) -> float:
    """Return where a ray goes through a cell's surface: regula falsi in the Illinois form."""
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


@kernel
def _in_cell(line: Line, cell: Cell, t: float, leave: float) -> float:
    """Return where a ray that is over a cell from t to `leave` hits it, NaN if it does not."""
    above = _at_cell(line, cell, t)
    if above <= 0.0:
        return t
    below = _at_cell(line, cell, leave)
    if below <= 0.0:
        return _crossing(line, cell, (t, above, leave, below))
    return np.nan


@kernel
def _in_tile(
    tiles: Tiles,
    slot: int,
    line: Line,
    corner: tuple[int, int],
    way: tuple[float, float, float, float],
) -> float:
    """Return where a ray hits the surface of a tile: NaN if it does not, −∞ if from below.

    `corner` is the column and row, in cells, of the tile's first node; `way` where the ray comes
    in, where it leaves, its squared distance from O at the foot, and where it began.
    """
    t, end, square, start = way
    starts, pool = tiles.tiling.starts, tiles.pool
    size, side, base = tiles.tiling.size, tiles.tiling.size + 3, tiles.tiling.base
    level = len(starts) - 1
    w = line.w0 + line.wd * t
    column = min(size - 1, max(0, int((line.x0 + line.xd * t) / w) - corner[0]))
    row = min(size - 1, max(0, int((line.y0 + line.yd * t) / w) - corner[1]))
    found = np.nan
    inside = True
    while inside:
        i, j, block = column >> level, row >> level, 1 << level
        leave, through_u = _leaves(line, (corner[0] + i * block, corner[1] + j * block), block, t)
        leave = min(leave, end)
        if level > 0:
            most = pool[slot, starts[level] + j * (size >> level) + i]
            if _nearest(square, t, leave) <= (base + most) ** 2:
                level -= 1
                continue
        else:
            k = (row + 1) * side + column + 1
            h, hu = pool[slot, k], pool[slot, k + 1]
            hv, huv = pool[slot, k + side], pool[slot, k + side + 1]
            if _nearest(square, t, leave) <= (base + max(h, hu, hv, huv)) ** 2:
                twist = np.float64(h) - hu - hv + huv
                cell = Cell(
                    corner[0] + column, corner[1] + row, base + h, hu - h, hv - h, twist, square
                )
                found = _in_cell(line, cell, t, leave)
                # What began below the ground hits nothing; else it is the border's rounding.
                found = -np.inf if found == start else found
        inside = np.isnan(found) and leave < end
        t = leave
        if through_u:
            column = (i + 1) * block if line.across > 0 else i * block - 1
            if level > 0:
                place = int((line.y0 + line.yd * t) / (line.w0 + line.wd * t)) - corner[1]
                row = min((j + 1) * block - 1, max(j * block, place))
        else:
            row = (j + 1) * block if line.along > 0 else j * block - 1
            if level > 0:
                place = int((line.x0 + line.xd * t) / (line.w0 + line.wd * t)) - corner[0]
                column = min((i + 1) * block - 1, max(i * block, place))
        inside = inside and min(column, row) >= 0 and max(column, row) < size
        if column >> (level + 1) != i >> 1 or row >> (level + 1) != j >> 1:
            level = min(level + 1, len(starts) - 1)
    return found


@kernel
def _span(
    origin: Vector, beam: Vector, floor: float, ceiling: float
) -> tuple[float, float, float, Vector]:
    """Return the distance of a ray's foot, where it is between ceiling and floor, and its foot.

    Start and end are distances from the foot, which are of the body's size whatever the range;
    the start is NaN for a ray that stays above the ceiling, goes away, or begins under the floor.
    Nobody follows a ray to where it passes O: its direction from there turns too fast.
    """
    closest = -(origin[0] * beam[0] + origin[1] * beam[1] + origin[2] * beam[2])
    foot = at(origin, beam, closest)
    square = foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2
    half = ceiling**2 - square
    if not half > 0.0 or closest + np.sqrt(half) < 0.0:
        return closest, np.nan, np.nan, foot
    end = np.sqrt(half)
    start = max(-end, -closest)
    under = floor**2 - square
    if under > 0.0 and start < np.sqrt(under):
        end = -np.sqrt(under)
        start = start if start < end else np.nan
    return closest, start, end, foot


@kernel
def needs(tiles: Tiles, origin: Vector, beam: Vector, wanted: AnyArray) -> None:
    """Mark in `wanted` (tiles,) all tiles that a ray may dip into, up to where it must have hit."""
    tiling = tiles.tiling
    _, t, end, foot = _span(origin, beam, tiles.floor, tiles.ceiling)
    square = foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2
    face = face_of(*at(foot, beam, t))
    while t < end:
        line = line_on(tiling, face, foot, beam)
        column, row = _square_of(line, t, tiling.size, tiling.across)
        on_face = True
        while on_face and t < end:
            first = (column * tiling.size, row * tiling.size)
            leave, through_u = _leaves(line, first, tiling.size, t)
            leave = min(leave, end)
            tile = (face * tiling.across + row) * tiling.across + column
            near = _nearest(square, t, leave)
            if near <= tiles.upper[tile] ** 2:
                wanted[tile] = True
            t = np.inf if near < tiles.lower[tile] ** 2 else leave
            column += line.across if through_u else 0
            row += 0 if through_u else line.along
            if min(column, row) < 0 or max(column, row) >= tiling.across:
                face = _next_face(face, line, through_u)
                on_face = False


@kernel
def hit(tiles: Tiles, origin: Vector, beam: Vector, wanted: AnyArray) -> tuple[float, int]:
    """Return the distance of the first hit, NaN for none, and the tile, −1 for none.

    A tile that is not there is marked in `wanted`, and −2 is returned for it. (There is one way
    out of this function and of those below it, because Numba then need not count references.)
    """
    tiling = tiles.tiling
    closest, t, end, foot = _span(origin, beam, tiles.floor, tiles.ceiling)
    start, found, met = t, np.nan, -1
    square = foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2
    face = face_of(*at(foot, beam, t))
    while t < end:
        line = line_on(tiling, face, foot, beam)
        column, row = _square_of(line, t, tiling.size, tiling.across)
        on_face = True
        while on_face and t < end:
            first = (column * tiling.size, row * tiling.size)
            leave, through_u = _leaves(line, first, tiling.size, t)
            leave = min(leave, end)
            tile = (face * tiling.across + row) * tiling.across + column
            if _nearest(square, t, leave) <= tiles.upper[tile] ** 2:
                slot = tiles.slots[tile]
                if slot < 0:
                    wanted[tile] = True
                    met, leave = -2, np.inf
                else:
                    found = _in_tile(tiles, slot, line, first, (t, leave, square, start))
                    leave = leave if np.isnan(found) else np.inf
                    met = tile if np.isfinite(found) else -1
            t = leave
            column += line.across if through_u else 0
            row += 0 if through_u else line.along
            if min(column, row) < 0 or max(column, row) >= tiling.across:
                face = _next_face(face, line, through_u)
                on_face = False
    return closest + found if met >= 0 else np.nan, met


@kernel
def normal_at(tiles: Tiles, point: Vector) -> Vector:
    """Return the outward unit normal at a point of the surface, whose tile is there.

    Slopes are central differences at the four nodes around, and bilinear between them, so that
    the normal is continuous; the surface itself has creases at the borders of cells.
    """
    tiling = tiles.tiling
    face, across, along = place_of(tiling, *point)
    number = tile_of(tiling, face, across, along)
    column = number % tiling.across * tiling.size
    row = number // tiling.across % tiling.across * tiling.size
    pool, slot = tiles.pool, tiles.slots[number]
    side = tiling.size + 3
    i = min(tiling.size - 1, max(0, int(across) - column))
    j = min(tiling.size - 1, max(0, int(along) - row))
    p, q = across - column - i, along - row - j
    slope_u, slope_v = 0.0, 0.0
    for dj in range(2):
        for di in range(2):
            weight = (p if di else 1.0 - p) * (q if dj else 1.0 - q)
            k = (j + dj + 1) * side + i + di + 1
            slope_u += weight * (pool[slot, k + 1] - pool[slot, k - 1])
            slope_v += weight * (pool[slot, k + side] - pool[slot, k - side])
    # Two cells of 2/cells each; the radius depends on the direction alone, hence r = |p|.
    cells = tiling.across * tiling.size
    slope_u, slope_v = 0.25 * cells * slope_u, 0.25 * cells * slope_v
    a, b, c, sign = face_axes(face)
    u, v = 2.0 * across / cells - 1.0, 2.0 * along / cells - 1.0
    length = np.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)
    w = sign * point[a]
    falls = (sign * (u * slope_u + v * slope_v) / w, -slope_u / w, -slope_v / w)
    normal = (
        point[0] / length + _part(falls, (a, b, c), 0),
        point[1] / length + _part(falls, (a, b, c), 1),
        point[2] / length + _part(falls, (a, b, c), 2),
    )
    norm = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    return normal[0] / norm, normal[1] / norm, normal[2] / norm


@kernel
def _part(values: Vector, axes: tuple[int, int, int], axis: int) -> float:
    """Return which of the values along w, u, v belongs to the axis 0, 1 or 2 of space."""
    if axes[0] == axis:
        return values[0]
    return values[1] if axes[1] == axis else values[2]


@kernel
def _borrowed(tiles: Tiles) -> Tiles:
    """Return the tiles as arrays without an owner: see :mod:`spcola.truth.borrowing`."""
    t = tiles.tiling
    starts = borrowed(t.starts)
    return Tiles(
        Tiling(t.across, t.size, starts, t.base),
        borrowed(tiles.slots),
        borrowed(tiles.pool),
        borrowed(tiles.lower),
        borrowed(tiles.upper),
        tiles.floor,
        tiles.ceiling,
    )


@kernel
def mark_needed(tiles: Tiles, origins: FloatArray, beams: FloatArray, wanted: AnyArray) -> None:
    """Mark in `wanted` (tiles,) the tiles that rays (N, 3), (N, 3) may need."""
    ours, marks = _borrowed(tiles), borrowed(wanted)
    for i in range(len(origins)):
        origin = (origins[i, 0], origins[i, 1], origins[i, 2])
        needs(ours, origin, (beams[i, 0], beams[i, 1], beams[i, 2]), marks)


@kernel
def first_hits(
    tiles: Tiles,
    rays: tuple[FloatArray, FloatArray],
    distance: FloatArray,
    normals: FloatArray,
    wanted: AnyArray,
) -> bool:
    """Fill distance (N,) and normals (N, 3) of the hits of rays; False if a tile is missing.

    The missing tiles are marked in `wanted` (tiles,); the results are void then.
    """
    origins, beams = rays
    ours, marks = _borrowed(tiles), borrowed(wanted)
    complete = True
    for i in range(len(origins)):
        origin = (origins[i, 0], origins[i, 1], origins[i, 2])
        beam = (beams[i, 0], beams[i, 1], beams[i, 2])
        found, tile = hit(ours, origin, beam, marks)
        distance[i] = found
        if tile < 0:
            complete = complete and tile != -2
            normals[i] = np.nan
            continue
        nx, ny, nz = normal_at(ours, at(origin, beam, found))
        normals[i, 0], normals[i, 1], normals[i, 2] = nx, ny, nz
    return complete


@kernel
def shadows(
    tiles: Tiles,
    rays: tuple[FloatArray, FloatArray],
    lift: float,
    out: AnyArray,
    wanted: AnyArray,
) -> bool:
    """Tell in `out` (N,) which rays from points of the ground meet ground; False as above.

    The points are lifted by `lift` above the ground, or onto it first if they lie below.
    """
    points, beams = rays
    ours, marks = _borrowed(tiles), borrowed(wanted)
    tiling = ours.tiling
    complete = True
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not np.isfinite(x + y + z):
            out[i] = False
            continue
        face, across, along = place_of(tiling, x, y, z)
        tile = tile_of(tiling, face, across, along)
        slot = ours.slots[tile]
        if slot < 0:
            marks[tile] = True
            complete = False
            continue
        column = tile % tiling.across * tiling.size
        row = tile // tiling.across % tiling.across * tiling.size
        ground = value_in(tiling, ours.pool[slot], across - column, along - row)
        length = np.sqrt(x * x + y * y + z * z)
        share = (max(length, ground) + lift) / length
        origin = (share * x, share * y, share * z)
        beam = (beams[i, 0], beams[i, 1], beams[i, 2])
        _, met = hit(ours, origin, beam, marks)
        complete = complete and met != -2
        out[i] = met >= 0
    return complete
