"""Cells on a cube around a body: lists of the features of its surface that reach into each.

A direction belongs to the face of its largest component; the gnomonic coordinate u of a face is
warped to ``s = u (1 + k) / (1 + k |u|)``, so that cells differ in width by √2 and not by 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled

_WARP = 0.41421356237309503
# Largest distance of a direction from the centre of its cell, over the cells along a face, as a
# chord of the unit sphere (checked by a test).
CELL_REACH = 1.25
# The largest component of a unit vector is at least 1/√3.
_LEAST_COMPONENT = 0.577


class Indexed(NamedTuple):
    """Features by cells, for the kernels.

    `numbers` (N, K) has a row for each feature; the features that may reach into cell c are
    ``items[start[c]:start[c + 1]]``, ascending.
    """

    numbers: FloatArray
    cells: int
    start: IntArray
    items: IntArray


@compiled
def warp(u: float) -> float:
    """Return the warped coordinate of the gnomonic one."""
    return u * (1.0 + _WARP) / (1.0 + _WARP * abs(u))


@compiled
def unwarp(s: float) -> float:
    """Return the gnomonic coordinate of the warped one."""
    return s / (1.0 + _WARP - _WARP * abs(s))


@compiled
def warp_step(u: float) -> float:
    """Return the derivative of the gnomonic coordinate u by the warped one."""
    return (1.0 + _WARP * abs(u)) ** 2 / (1.0 + _WARP)


@compiled
def face_place(x: float, y: float, z: float) -> tuple[int, float, float]:
    """Return the face (0 … 5) of a direction, and its warped coordinates there."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return (0 if x > 0 else 1), warp(y / ax), warp(z / ax)
    if ay >= az:
        return (2 if y > 0 else 3), warp(x / ay), warp(z / ay)
    return (4 if z > 0 else 5), warp(x / az), warp(y / az)


@compiled
def cell_at(face: int, s: float, t: float, cells: int) -> int:
    """Return the number of the cell at warped coordinates of a face."""
    column = min(cells - 1, int((s + 1.0) * 0.5 * cells))
    row = min(cells - 1, int((t + 1.0) * 0.5 * cells))
    return (face * cells + row) * cells + column


@compiled
def cell_of(x: float, y: float, z: float, cells: int) -> int:
    """Return the cell (as numbered by :func:`cell_directions`) of a direction."""
    face, s, t = face_place(x, y, z)
    return cell_at(face, s, t, cells)


def face_directions(places: FloatArray) -> FloatArray:
    """Return unit vectors (6, N, N, 3) to warped coordinates `places` (N,) along both axes.

    Indexed [face, t, s].
    """
    unwarped = places / (1.0 + _WARP - _WARP * np.abs(places))
    v, u = np.meshgrid(unwarped, unwarped, indexing="ij")
    one = np.ones_like(u)
    faces = [(s * one, u, v) for s in (1, -1)]
    faces += [(u, s * one, v) for s in (1, -1)]
    faces += [(u, v, s * one) for s in (1, -1)]
    vectors = np.stack([np.stack(face, axis=-1) for face in faces])
    lengths = np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2 + vectors[..., 2] ** 2)
    return vectors / lengths[..., None]


def cell_directions(cells: int) -> FloatArray:
    """Return unit vectors (6·cells², 3) to the centres of the cells of a cube."""
    centre = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    return face_directions(centre).reshape(-1, 3)


@compiled
def _span(low: float, high: float, depth: tuple[float, float], cells: int) -> tuple[int, int]:
    """Return the first cell, and the one after the last, that a component's range may touch."""
    least = warp(low / depth[0] if low < 0.0 else low / depth[1])
    most = warp(high / depth[1] if high < 0.0 else high / depth[0])
    first = int(np.floor((least + 1.0) * 0.5 * cells - 1e-9))
    last = int(np.floor((most + 1.0) * 0.5 * cells + 1e-9))
    return max(first, 0), min(last, cells - 1) + 1


@compiled
def _list_cells(
    directions: FloatArray, reach: FloatArray, centres: FloatArray, cells: int, found: IntArray
) -> int:
    """Write (cell, feature) pairs into `found` (M, 2) while there is room; return how many."""
    count = 0
    for item in range(len(directions)):
        d, chord = directions[item], reach[item]
        limit = (chord + CELL_REACH / cells) ** 2
        for face in range(6):
            axis = face // 2
            depth = d[axis] if face % 2 == 0 else -d[axis]
            if depth + chord < _LEAST_COMPONENT:
                continue
            near = max(depth - chord, _LEAST_COMPONENT), min(depth + chord, 1.0)
            a, b = d[0 if axis else 1], d[1 if axis == 2 else 2]
            first, end = _span(a - chord, a + chord, near, cells)
            first_row, end_row = _span(b - chord, b + chord, near, cells)
            for row in range(first_row, end_row):
                for column in range(first, end):
                    cell = (face * cells + row) * cells + column
                    c = centres[cell]
                    away = (c[0] - d[0]) ** 2 + (c[1] - d[1]) ** 2 + (c[2] - d[2]) ** 2
                    if away <= limit:
                        if count < len(found):
                            found[count, 0], found[count, 1] = cell, item
                        count += 1
    return count


def cells_for(count: int) -> int:
    """Return the number of cells along a face for `count` features: some four cells for each."""
    return int(np.clip(np.sqrt(4.0 * count / 6.0), 8, 512))


def index_features(
    numbers: FloatArray, directions: FloatArray, chords: FloatArray, cells: int
) -> Indexed:
    """List for each cell the features that may reach into it.

    Parameters
    ----------
    numbers : (N, K) ndarray
        Parameters of the features' kernel.
    directions : (N, 3) ndarray
        Unit vectors to their centres.
    chords : (N,) ndarray
        Their reaches, as chords of the unit sphere.
    cells : int
        Number along each side of a face.
    """
    directions, chords = np.ascontiguousarray(directions), np.ascontiguousarray(chords)
    centres = cell_directions(cells)
    count = _list_cells(directions, chords, centres, cells, np.empty((0, 2), np.int64))
    found = np.empty((count, 2), np.int64)
    _list_cells(directions, chords, centres, cells, found)
    order = np.argsort(found[:, 0], kind="stable")
    counts = np.bincount(found[:, 0], minlength=len(centres))
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Indexed(np.ascontiguousarray(numbers), cells, start, found[order, 1])
