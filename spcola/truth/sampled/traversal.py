"""Rays over the tiles of a cube: tiles needed, hits, and normals there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.compilation import compiled
from spcola.truth.sampled.crossing import in_tile
from spcola.truth.sampled.cube import Tiling, face_axes, face_of, place_in_tile, value_in
from spcola.truth.sampled.face_lines import (
    Vector,
    at,
    leaves,
    line_on,
    nearest,
    next_face,
    square_of,
)
from spcola.truth.sampled.uncounted import uncounted


class Tiles(NamedTuple):
    """The tiles for the kernels; see :class:`spcola.truth.sampled.tile_store.TileStore`.

    `floor` and `ceiling` are radii between which the surface lies.
    """

    tiling: Tiling
    slots: IntArray
    pool: FloatArray
    lower: FloatArray
    upper: FloatArray
    floor: float
    ceiling: float


@compiled
def _span(
    origin: Vector, beam: Vector, floor: float, ceiling: float
) -> tuple[float, float, float, Vector]:
    """Return a ray's foot distance, its interval between ceiling and floor, and its foot.

    Start and end are distances from the foot, which are of the body's size whatever the range;
    the start is NaN for a ray that remains above the ceiling, goes away, or begins under the
    floor. Rays are not followed to where they pass O: their direction from there changes too fast.
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


@compiled
def needs(tiles: Tiles, origin: Vector, beam: Vector, wanted: AnyArray) -> None:
    """Mark in `wanted` (tiles,) all tiles that a ray may enter, up to its certain hit."""
    tiling = tiles.tiling
    _, t, end, foot = _span(origin, beam, tiles.floor, tiles.ceiling)
    square = foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2
    face = face_of(*at(foot, beam, t))
    while t < end:
        line = line_on(tiling, face, foot, beam)
        column, row = square_of(line, t, tiling.size, tiling.across)
        on_face = True
        while on_face and t < end:
            first = (column * tiling.size, row * tiling.size)
            leave, through_u = leaves(line, first, tiling.size, t)
            leave = min(leave, end)
            tile = (face * tiling.across + row) * tiling.across + column
            near = nearest(square, t, leave)
            if near <= tiles.upper[tile] ** 2:
                wanted[tile] = True
            t = np.inf if near < tiles.lower[tile] ** 2 else leave
            column += line.across if through_u else 0
            row += 0 if through_u else line.along
            if min(column, row) < 0 or max(column, row) >= tiling.across:
                face = next_face(face, line, through_u)
                on_face = False


@compiled
def hit(tiles: Tiles, origin: Vector, beam: Vector, wanted: AnyArray) -> tuple[float, int]:
    """Return the distance of the first hit, NaN for none, and the tile, −1 for none.

    A missing tile is marked in `wanted`, and −2 is returned for it. (This function and those below
    it have a single exit, so that Numba need not count references.)
    """
    tiling = tiles.tiling
    closest, t, end, foot = _span(origin, beam, tiles.floor, tiles.ceiling)
    start, found, met = t, np.nan, -1
    square = foot[0] ** 2 + foot[1] ** 2 + foot[2] ** 2
    face = face_of(*at(foot, beam, t))
    while t < end:
        line = line_on(tiling, face, foot, beam)
        column, row = square_of(line, t, tiling.size, tiling.across)
        on_face = True
        while on_face and t < end:
            first = (column * tiling.size, row * tiling.size)
            leave, through_u = leaves(line, first, tiling.size, t)
            leave = min(leave, end)
            tile = (face * tiling.across + row) * tiling.across + column
            if nearest(square, t, leave) <= tiles.upper[tile] ** 2:
                slot = tiles.slots[tile]
                if slot < 0:
                    wanted[tile] = True
                    met, leave = -2, np.inf
                else:
                    found = in_tile(
                        tiling, (tiles.pool, slot), line, first, (t, leave, square, start)
                    )
                    leave = leave if np.isnan(found) else np.inf
                    met = tile if np.isfinite(found) else -1
            t = leave
            column += line.across if through_u else 0
            row += 0 if through_u else line.along
            if min(column, row) < 0 or max(column, row) >= tiling.across:
                face = next_face(face, line, through_u)
                on_face = False
    return closest + found if met >= 0 else np.nan, met


@compiled
def normal_at(tiles: Tiles, point: Vector) -> Vector:
    """Return the outward unit normal at a point of the surface, whose tile is present.

    Computed from the slopes at the four nodes around, bilinear between them, so that the normal is
    continuous; the surface itself has creases at the borders of cells.
    """
    tiling = tiles.tiling
    tile, across, along = place_in_tile(tiling, *point)
    slope_u, slope_v = _slopes(tiling, (tiles.pool, tiles.slots[tile]), across, along)
    a, b, c, sign = face_axes(tile // tiling.across**2)
    length = np.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)
    w = sign * point[a]
    u, v = point[b] / w, point[c] / w
    # The gradient of |p| less that of the radius, which depends on u and v alone.
    falls = (sign * (u * slope_u + v * slope_v) / w, -slope_u / w, -slope_v / w)
    x = point[0] / length + _part(falls, (a, b, c), 0)
    y = point[1] / length + _part(falls, (a, b, c), 1)
    z = point[2] / length + _part(falls, (a, b, c), 2)
    norm = np.sqrt(x * x + y * y + z * z)
    return x / norm, y / norm, z / norm


@compiled
def _slopes(
    tiling: Tiling, tile: tuple[FloatArray, int], across: float, along: float
) -> tuple[float, float]:
    """Return ∂r/∂u and ∂r/∂v at coordinates in a tile, from central differences at its nodes."""
    pool, slot = tile
    side = tiling.size + 3
    i = min(tiling.size - 1, max(0, int(across)))
    j = min(tiling.size - 1, max(0, int(along)))
    p, q = across - i, along - j
    slope_u, slope_v = 0.0, 0.0
    for dj in range(2):
        for di in range(2):
            weight = (p if di else 1.0 - p) * (q if dj else 1.0 - q)
            k = (j + dj + 1) * side + i + di + 1
            slope_u += weight * (pool[slot, k + 1] - pool[slot, k - 1])
            slope_v += weight * (pool[slot, k + side] - pool[slot, k - side])
    # Over two cells, of which a face has this many from −1 to 1.
    per_cell = 0.25 * tiling.across * tiling.size
    return per_cell * slope_u, per_cell * slope_v


@compiled
def _part(values: Vector, axes: tuple[int, int, int], axis: int) -> float:
    """Return the value along w, u or v for the axis 0, 1 or 2 of space."""
    if axes[0] == axis:
        return values[0]
    return values[1] if axes[1] == axis else values[2]


@compiled
def _uncounted(tiles: Tiles) -> Tiles:
    """Return the tiles as arrays without an owner: see :mod:`spcola.truth.sampled.uncounted`."""
    t = tiles.tiling
    starts = uncounted(t.starts)
    return Tiles(
        Tiling(t.across, t.size, starts, t.base),
        uncounted(tiles.slots),
        uncounted(tiles.pool),
        uncounted(tiles.lower),
        uncounted(tiles.upper),
        tiles.floor,
        tiles.ceiling,
    )


@compiled
def mark_needed(tiles: Tiles, origins: FloatArray, beams: FloatArray, wanted: AnyArray) -> None:
    """Mark in `wanted` (tiles,) the tiles that rays (N, 3), (N, 3) may need."""
    ours, marks = _uncounted(tiles), uncounted(wanted)
    for i in range(len(origins)):
        origin = (origins[i, 0], origins[i, 1], origins[i, 2])
        needs(ours, origin, (beams[i, 0], beams[i, 1], beams[i, 2]), marks)


@compiled
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
    ours, marks = _uncounted(tiles), uncounted(wanted)
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


@compiled
def shadows(
    tiles: Tiles,
    rays: tuple[FloatArray, FloatArray],
    lift: float,
    out: AnyArray,
    wanted: AnyArray,
) -> bool:
    """Store in `out` (N,) which rays from points of the ground meet ground; False as above.

    The points are lifted by `lift` above the ground, or onto it first if they lie below.
    """
    points, beams = rays
    ours, marks = _uncounted(tiles), uncounted(wanted)
    tiling = ours.tiling
    complete = True
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not np.isfinite(x + y + z):
            out[i] = False
            continue
        tile, across, along = place_in_tile(tiling, x, y, z)
        slot = ours.slots[tile]
        if slot < 0:
            marks[tile] = True
            complete = False
            continue
        ground = value_in(tiling, ours.pool[slot], across, along)
        length = np.sqrt(x * x + y * y + z * z)
        share = (max(length, ground) + lift) / length
        origin = (share * x, share * y, share * z)
        beam = (beams[i, 0], beams[i, 1], beams[i, 2])
        _, met = hit(ours, origin, beam, marks)
        complete = complete and met != -2
        out[i] = met >= 0
    return complete
