"""Rays on the faces of a cube: a straight line in space is a straight line on each face.

A ray is its foot, the point nearest to O, and its unit vector; places on it are distances from the
foot, and the distance from O grows from there to both sides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.compilation import compiled
from spcola.truth.sampled.cube import Tiling, face_axes

Vector = tuple[float, float, float]


class Line(NamedTuple):
    """A ray on a face: w = w0 + t·wd, and u, v in cells are (x0 + t·xd)/w, (y0 + t·yd)/w.

    `across` and `along` are the directions of u and v: 1, −1, or 0 for constant.
    """

    w0: float
    wd: float
    x0: float
    xd: float
    y0: float
    yd: float
    across: int
    along: int


@compiled
def at(start: Vector, beam: Vector, t: float) -> Vector:
    """Return the point at t along a ray."""
    return start[0] + t * beam[0], start[1] + t * beam[1], start[2] + t * beam[2]


@compiled
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


@compiled
def _meets(start: float, rate: float, line: Line, border: int, t: float) -> float:
    """Return where a coordinate reaches `border`, at `t` or later; infinity if it never does."""
    slope = rate - border * line.wd
    if slope == 0.0:
        return np.inf
    at = (border * line.w0 - start) / slope
    # On the far side of the pole of the projection the line belongs to the opposite face.
    if not line.w0 + line.wd * at > 0.0:
        return np.inf
    return max(at, t)


@compiled
def leaves(line: Line, first: tuple[int, int], size: int, t: float) -> tuple[float, bool]:
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


@compiled
def square_of(line: Line, t: float, size: int, count: int) -> tuple[int, int]:
    """Return the column and row, of squares of `size` cells, at t."""
    w = line.w0 + line.wd * t
    # Sizes are powers of two, and the division of integers is slow.
    column = int((line.x0 + line.xd * t) / w / size)
    row = int((line.y0 + line.yd * t) / w / size)
    return min(count - 1, max(0, column)), min(count - 1, max(0, row))


@compiled
def next_face(face: int, line: Line, through_u: bool) -> int:
    """Return the face beyond the side through which a ray leaves `face`."""
    _, b, c, _ = face_axes(face)
    if through_u:
        return 2 * b + (line.across < 0)
    return 2 * c + (line.along < 0)


@compiled
def nearest(square: float, t: float, end: float) -> float:
    """Return the least squared distance from O between t and `end`, both from the foot."""
    if t > 0.0:
        return square + t * t
    return square + end * end if end < 0.0 else square
