"""Returns sorted by place: cubes of space, and integer places within them.

A scan comes in the order of time, a mapola needs the returns around a place. Sorted by the cubes of
a body-fixed lattice, near returns are stored together. Cubes do not depend on a surface: tracks,
overhangs and returns far off any ground are treated like all others.

Coordinates are whole numbers of quanta; a cube's edge is a power of two of them, so that the upper
bits of a coordinate are its cube and the lower ones the place in it, 64 bits for all three axes.
The rounding of a return depends on nothing else: not on the cubes, nor on its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lidar.scans.cubes.box import Box
from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline

QUANTUM_M = 5e-5
"""Unit of places, metres: rounding displaces a return by at most 25 µm along each axis, a
thousandth of the noise of a range."""

# Bits of a place along one axis; three of them fit one number.
_ROOM = 21
# Edges of 41 cm to 105 m, as powers of two of a quantum; larger ones do not fit.
_FEWEST_BITS, _USUAL_BITS, MOST_BITS = 13, 16, _ROOM
# Returns per cube: with fewer the index dominates, with more too many are read in vain.
_AIM = 120


@dataclass(frozen=True, eq=False)
class CubedPoints:
    """N points in the T occupied cubes of a lattice.

    Attributes
    ----------
    bits : int
        The edge of a cube is 2 ** bits quanta.
    cube : (T, 3) int64 ndarray
        Cube (i, j, k) reaches from i to i + 1 edges along x, and so on.
    start : (T + 1,) int64 ndarray
        Rows ``start[t]`` to ``start[t + 1]`` lie in cube t.
    place : (N,) uint64 ndarray
        Quanta from the lowest corner of the cube along x, y and z, 21 bits each from the lowest.
    """

    bits: int
    cube: IntArray
    start: IntArray
    place: IntArray

    @cached_property
    def middle(self) -> FloatArray:
        """Middles (T, 3) of the cubes, metres."""
        return (self.cube + 0.5) * edge_of(self.bits)

    @cached_property
    def corner(self) -> IntArray:
        """Lowest corners (T, 3) of the cubes, quanta."""
        return self.cube << self.bits

    @property
    def reach(self) -> float:
        """Largest distance of a point from the middle of its cube, metres."""
        return float(np.sqrt(0.75) * edge_of(self.bits))

    def part(self, begin: int, end: int) -> CubedPoints:
        """Return rows `begin` to `end`, at least one, with their cubes."""
        first = int(np.searchsorted(self.start, begin, side="right")) - 1
        last = int(np.searchsorted(self.start, end, side="left"))
        start = np.clip(self.start[first : last + 1], begin, end) - begin
        return CubedPoints(self.bits, self.cube[first:last], start, self.place[begin:end])

    def points(self) -> FloatArray:
        """Return all points (N, 3), metres."""
        chosen = np.arange(len(self.cube))
        points = np.empty((len(self.place), 3))
        _unpack(self.place, self.start, self.corner, chosen, points)
        return points

    def points_at(self, rows: IntArray) -> FloatArray:
        """Return the points (K, 3) of some rows, ascending, metres."""
        cube = np.searchsorted(self.start, rows, side="right") - 1
        points = np.empty((len(rows), 3))
        each = np.arange(len(rows) + 1)
        _unpack(self.place[rows], each, self.corner[cube], each[:-1], points)
        return points


def edge_of(bits: int) -> float:
    """Return the edge, metres, of cubes of 2 ** bits quanta."""
    return float(QUANTUM_M * (1 << bits))


def sort_into_cubes(points: FloatArray, bits: int | None = None) -> tuple[CubedPoints, IntArray]:
    """Sort points into cubes.

    Parameters
    ----------
    points : (N, 3) ndarray
        Metres, finite.
    bits : int, optional
        Size of the cubes; by default such that some hundreds of returns share one.

    Returns
    -------
    CubedPoints
    (N,) int64 ndarray
        Number among `points` of each row; points of a cube keep their order.
    """
    steps = _quanta(np.ascontiguousarray(points))
    if bits is None:
        bits = _fitting_bits(steps)
    cube, start, place, order = _sorted(steps, bits)
    return CubedPoints(bits, cube, start, place), order


def _fitting_bits(steps: IntArray) -> int:
    """Size of cube with about the desired number of returns."""
    bits = _USUAL_BITS
    while bits < MOST_BITS and len(steps) < _AIM / 2 * _occupied(steps, bits):
        bits += 1
    while bits > _FEWEST_BITS and len(steps) > _AIM * 2 * _occupied(steps, bits):
        bits -= 1
    return bits


def _occupied(steps: IntArray, bits: int) -> int:
    """Count the occupied cubes."""
    return len(_numbered(steps, bits)[0])


@compiled
def _quanta(points: FloatArray) -> IntArray:
    """Coordinates (N, 3) in whole quanta."""
    steps = np.empty(points.shape, dtype=np.int64)
    for n in range(len(points)):
        for axis in range(3):
            steps[n, axis] = np.int64(np.rint(points[n, axis] / QUANTUM_M))
    return steps


@compiled
def _numbered(steps: IntArray, bits: int) -> tuple[IntArray, IntArray]:
    """Occupied cubes (T, 3) in the order of their first points, and the cube of each point (N,)."""
    count = len(steps)
    size = 64
    while size < 2 * count:
        size *= 2
    slots = np.full(size, -1, dtype=np.int32)
    cube = np.empty((count, 3), dtype=np.int64)
    number = np.empty(count, dtype=np.int32)
    known = 0
    last = -1
    for n in range(count):
        i, j, k = steps[n, 0] >> bits, steps[n, 1] >> bits, steps[n, 2] >> bits
        # The next return of a scan is mostly in the same cube as the last one.
        if last >= 0 and cube[last, 0] == i and cube[last, 1] == j and cube[last, 2] == k:
            number[n] = last
            continue
        slot = (i * 73856093 ^ j * 19349663 ^ k * 83492791) & (size - 1)
        while True:
            at = slots[slot]
            if at < 0:
                slots[slot] = known
                cube[known, 0], cube[known, 1], cube[known, 2] = i, j, k
                at = known
                known += 1
            if cube[at, 0] == i and cube[at, 1] == j and cube[at, 2] == k:
                number[n] = at
                last = at
                break
            slot = (slot + 1) & (size - 1)
    return cube[:known].copy(), number


@compiled
def _sorted(steps: IntArray, bits: int) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Cubes, where their rows start, the places of the sorted points, and their old numbers."""
    cube, number = _numbered(steps, bits)
    count = len(steps)
    start = np.zeros(len(cube) + 1, dtype=np.int64)
    for n in range(count):
        start[number[n] + 1] += 1
    for t in range(len(cube)):
        start[t + 1] += start[t]
    free = start[:-1].copy()
    place = np.empty(count, dtype=np.uint64)
    order = np.empty(count, dtype=np.int64)
    for n in range(count):
        t = number[n]
        row = free[t]
        free[t] += 1
        order[row] = n
        packed = np.uint64(0)
        for axis in range(3):
            inside = steps[n, axis] - (cube[t, axis] << bits)
            packed |= np.uint64(inside) << np.uint64(axis * _ROOM)
        place[row] = packed
    return cube, start, place, order


@compiled_inline
def _coordinate(place: int, axis: int, corner: int) -> float:
    """Coordinate of a return along an axis, metres; that of its cube's corner is in quanta."""
    inside = (place >> np.uint64(axis * _ROOM)) & np.uint64((1 << _ROOM) - 1)
    return (corner + np.int64(inside)) * QUANTUM_M


@compiled
def _unpack(
    place: IntArray, start: IntArray, corner: IntArray, chosen: IntArray, points: FloatArray
) -> None:
    """Write the points of the `chosen` cubes into `points`, one cube after the other."""
    row = 0
    for t in chosen:
        for n in range(start[t], start[t + 1]):
            for axis in range(3):
                points[row, axis] = _coordinate(place[n], axis, corner[t, axis])
            row += 1


BoxArrays = tuple[FloatArray, FloatArray, FloatArray]
"""Centre, axes and half lengths of a box, as the kernels take them."""


@compiled_inline
def _is_inside(x: float, y: float, z: float, box: BoxArrays, reach: float) -> bool:
    """Whether the place lies in the box, or within `reach` beyond its sides."""
    center, axes, half = box
    inside = True
    for axis in range(3):
        along = (
            axes[axis, 0] * (x - center[0])
            + axes[axis, 1] * (y - center[1])
            + axes[axis, 2] * (z - center[2])
        )
        inside &= abs(along) <= half[axis] + reach
    return inside


@compiled
def _touching_cubes(
    middle: FloatArray, start: IntArray, box: BoxArrays, across: FloatArray
) -> tuple[IntArray, int]:
    chosen = np.empty(len(middle), dtype=np.int64)
    center = box[0]
    count = total = 0
    for t in range(len(middle)):
        x, y, z = middle[t, 0], middle[t, 1], middle[t, 2]
        near = abs(x - center[0]) <= across[0]
        near &= abs(y - center[1]) <= across[1]
        near &= abs(z - center[2]) <= across[2]
        near &= _is_inside(x, y, z, box, 0.0)
        chosen[count] = t
        count += near
        total += near * (start[t + 1] - start[t])
    return chosen[:count], total


@compiled
def _unpack_inside(
    cubes: tuple[IntArray, IntArray, IntArray],
    chosen: IntArray,
    box: BoxArrays,
    reach: float,
    points: FloatArray,
    rows: IntArray,
) -> int:
    place, start, corner = cubes
    found = 0
    for t in chosen:
        for n in range(start[t], start[t + 1]):
            x = _coordinate(place[n], 0, corner[t, 0])
            y = _coordinate(place[n], 1, corner[t, 1])
            z = _coordinate(place[n], 2, corner[t, 2])
            points[found, 0], points[found, 1], points[found, 2] = x, y, z
            rows[found] = n
            found += _is_inside(x, y, z, box, reach)
    return found


@compiled
def _keep_inside(points: FloatArray, rows: IntArray, box: BoxArrays) -> int:
    count = 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        points[count, 0], points[count, 1], points[count, 2] = x, y, z
        rows[count] = rows[n]
        count += _is_inside(x, y, z, box, 0.0)
    return count


def touching_cubes(cubes: CubedPoints, box: Box, reach: float = 0.0) -> tuple[IntArray, int]:
    """Return the cubes (numbers) that may have points within `reach` (m) of `box`; how many points.

    A cube that lies apart from the box along an axis of either has none.
    """
    room, slant = 0.5 * edge_of(cubes.bits) + reach, np.abs(box.axes)
    along = box.half + 0.5 * edge_of(cubes.bits) * slant.sum(axis=1) + reach
    wide = (box.center, box.axes, along)
    chosen, total = _touching_cubes(cubes.middle, cubes.start, wide, room + box.half @ slant)
    return chosen, total


def unpack_inside(
    cubes: CubedPoints,
    chosen: IntArray,
    box: Box,
    points: FloatArray,
    rows: IntArray,
    *,
    reach: float = 0.0,
) -> int:
    """Unpack the points in `box`, or within `reach` metres of its sides; return how many.

    Points of the `chosen` cubes (numbers) are written to the front of `points` (M, 3), metres,
    and their rows to that of `rows` (M,), which have room for all points of these cubes.
    """
    packed = (cubes.place, cubes.start, cubes.corner)
    arrays = (box.center, box.axes, box.half)
    found: int = _unpack_inside(packed, chosen, arrays, reach, points, rows)
    return found


def keep_inside(points: FloatArray, rows: IntArray, box: Box) -> int:
    """Move the `points` (N, 3), metres, in `box` to the front; return how many there are.

    Their order remains; their numbers `rows` (N,) are moved with them. Both arrays are changed.
    Points without a place (NaN) are never inside.
    """
    count: int = _keep_inside(points, rows, (box.center, box.axes, box.half))
    return count
