"""The tiles of a cube around a body: directions of their nodes, and their contents.

A direction p belongs to the face of its largest component w; there it has gnomonic coordinates u,
v, its other components divided by w, in axis order. A face has ``across · size`` cells along each;
their nodes are shared with the neighbouring face along an edge, where both interpolate between the
same values, so that there is no gap between faces. A straight line in space is a straight line on
each face, which is why rays are followed here.

A tile contains float32 numbers: its nodes with one more on each side (for slopes), row after row of
v, then the maxima over 2 × 2 cells, over 4 × 4, and so on to the whole tile.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import AnyArray, FloatArray, IntArray
from spcola.compilation import compiled


class Tiling(NamedTuple):
    """Division of the faces of the cube into tiles and cells.

    Attributes
    ----------
    across : int
        Tiles along each side of a face.
    size : int
        Cells along each side of a tile, a power of two.
    starts : (levels + 1,) ndarray
        Start, in a tile, of the maxima over ``2 ** level`` cells; that of level 0 is unused.
    base : float
        Reference value of the numbers in a tile.
    """

    across: int
    size: int
    starts: IntArray
    base: float

    @classmethod
    def of(cls, across: int, size: int, base: float) -> Tiling:
        """Return the tiling with its `starts`."""
        starts = [0, (size + 3) ** 2]
        while size >> (len(starts) - 1) > 1:
            starts.append(starts[-1] + (size >> (len(starts) - 1)) ** 2)
        return cls(across, size, np.array(starts), base)

    @property
    def total(self) -> int:
        """Number of tiles on all faces."""
        return 6 * self.across**2

    @property
    def nodes(self) -> int:
        """Number of nodes of a tile, those around it included."""
        return (self.size + 3) ** 2

    @property
    def length(self) -> int:
        """Number of values of a tile."""
        return int(self.starts[-1]) + 1


@compiled
def face_of(x: float, y: float, z: float) -> int:
    """Return the face (+x, −x, +y, −y, +z, −z: 0 … 5) of a direction."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return 0 if x > 0 else 1
    if ay >= az:
        return 2 if y > 0 else 3
    return 4 if z > 0 else 5


@compiled
def face_axes(face: int) -> tuple[int, int, int, float]:
    """Return the axes of w, u and v of a face and the sign of w."""
    axis = face >> 1
    sign = -1.0 if face & 1 else 1.0
    return axis, 1 if axis == 0 else 0, 1 if axis == 2 else 2, sign


@compiled
def place_of(tiling: Tiling, x: float, y: float, z: float) -> tuple[int, float, float]:
    """Return the face of a direction and its coordinates there, in cells from the first node."""
    face = face_of(x, y, z)
    if face < 2:
        w, u, v = abs(x), y, z
    elif face < 4:
        w, u, v = abs(y), x, z
    else:
        w, u, v = abs(z), x, y
    half = 0.5 * tiling.across * tiling.size
    return face, (u / w + 1.0) * half, (v / w + 1.0) * half


@compiled
def tile_of(tiling: Tiling, face: int, across: float, along: float) -> int:
    """Return the number of the tile at coordinates in cells on a face."""
    column = min(tiling.across - 1, max(0, int(across) // tiling.size))
    row = min(tiling.across - 1, max(0, int(along) // tiling.size))
    return (face * tiling.across + row) * tiling.across + column


@compiled
def place_in_tile(tiling: Tiling, x: float, y: float, z: float) -> tuple[int, float, float]:
    """Return the tile of a direction and its coordinates there, in cells from the first node."""
    face, across, along = place_of(tiling, x, y, z)
    tile = tile_of(tiling, face, across, along)
    column, row = tile % tiling.across, tile // tiling.across % tiling.across
    return tile, across - column * tiling.size, along - row * tiling.size


@compiled
def tiles_of(tiling: Tiling, directions: FloatArray, wanted: AnyArray) -> None:
    """Mark in `wanted` (tiles,) the tiles of the `directions` (N, 3)."""
    for i in range(len(directions)):
        face, across, along = place_of(tiling, directions[i, 0], directions[i, 1], directions[i, 2])
        wanted[tile_of(tiling, face, across, along)] = True


@compiled
def tile_directions(tiling: Tiling, tiles: IntArray) -> FloatArray:
    """Return the unit vectors (tiles · nodes, 3) to the nodes of the `tiles`."""
    out, count = np.empty((len(tiles) * (tiling.size + 3) ** 2, 3)), 0
    cells = tiling.across * tiling.size
    for tile in tiles:
        face = tile // (tiling.across * tiling.across)
        row = (tile // tiling.across) % tiling.across
        column = tile % tiling.across
        a, b, c, sign = face_axes(face)
        for j in range(row * tiling.size - 1, (row + 1) * tiling.size + 2):
            v = (2.0 * j - cells) / cells
            for i in range(column * tiling.size - 1, (column + 1) * tiling.size + 2):
                u = (2.0 * i - cells) / cells
                length = np.sqrt(1.0 + u * u + v * v)
                out[count, a] = sign / length
                out[count, b] = u / length
                out[count, c] = v / length
                count += 1
    return out


@compiled
def fill_tile(tiling: Tiling, values: FloatArray, tile: FloatArray) -> tuple[float, float]:
    """Fill `tile` from the `values` (nodes,); return the least and greatest inside it."""
    size, side = tiling.size, tiling.size + 3
    for k in range(side * side):
        tile[k] = values[k] - tiling.base
    low, high = np.inf, -np.inf
    for j in range(1, size + 2):
        for i in range(1, size + 2):
            low = min(low, tile[j * side + i])
            high = max(high, tile[j * side + i])
    levels = len(tiling.starts)
    if levels == 1:
        return tiling.base + low, tiling.base + high
    start, half = tiling.starts[1], size // 2
    for j in range(half):
        for i in range(half):
            most = -np.inf
            for row in range(2 * j + 1, 2 * j + 4):
                for column in range(2 * i + 1, 2 * i + 4):
                    most = max(most, tile[row * side + column])
            tile[start + j * half + i] = most
    for level in range(2, levels):
        below, start, half = start, tiling.starts[level], half // 2
        for j in range(half):
            for i in range(half):
                k = below + 4 * j * half + 2 * i
                first = max(tile[k], tile[k + 1])
                tile[start + j * half + i] = max(first, tile[k + 2 * half], tile[k + 2 * half + 1])
    return tiling.base + low, tiling.base + high


@compiled
def value_in(tiling: Tiling, tile: FloatArray, across: float, along: float) -> float:
    """Return the bilinear value at coordinates in cells from the first node of the tile."""
    side = tiling.size + 3
    i = min(tiling.size - 1, max(0, int(across)))
    j = min(tiling.size - 1, max(0, int(along)))
    k = (j + 1) * side + i + 1
    s, t = across - i, along - j
    near = tile[k] + s * (tile[k + 1] - tile[k])
    far = tile[k + side] + s * (tile[k + side + 1] - tile[k + side])
    return tiling.base + near + t * (far - near)


@compiled
def look_up(
    tiling: Tiling, slots: IntArray, pool: FloatArray, directions: FloatArray, out: FloatArray
) -> None:
    """Fill `out` (N,) with the values in `directions` (N, 3), whose tiles are present."""
    for i in range(len(directions)):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        tile, across, along = place_in_tile(tiling, x, y, z)
        out[i] = value_in(tiling, pool[slots[tile]], across, along)
