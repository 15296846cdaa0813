"""Points without an edge to the others of their 2 × 2 aggregate, moved to the aggregate next to it.

Where a hole is one point wide, or two points of the mask meet at a corner, a 2 × 2 aggregate joins
points of different pieces. All coarser levels then connect the pieces there, and the iterations
grow with the number of such places. An isolated point has no edge to the others of its aggregate;
here it moves to the aggregate that it has an edge to. These points are few, so the kernels of a
whole level ignore them.

Moving a point d changes the row of the prolongation P at d from its own aggregate X to another, Y.
Smoothed on either side, as in the cycle, P changes by φ (e_Y − e_X)ᵀ, where φ is the smoother's
response to a unit at d: a patch of 5 × 5 points. Black points have φ = 0, because they are smoothed
anew on either side of P.

The coarse matrix is still at least ½ PᵀAP (see `multigrid`): if an isolated point has a second
edge, of weight w to an aggregate Z, then Y and Z are joined by the aggregate V in the corner
between them, and w (y − z)² ≤ 2 w (y − v)² + 2 w (v − z)².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import Bands, compiled, compiled_inline
from spcola.heights.smoothing import Level


@dataclass(frozen=True, eq=False)
class IsolatedPoints:
    """The isolated points of one level that change the cycle: the red ones.

    Parameters
    ----------
    place : (n, 4) integer ndarray
        Row and column of each point and of its new aggregate, all in padded arrays.
    patch : (n, 5, 5) ndarray
        φ around each.
    """

    place: IntArray
    patch: FloatArray

    @classmethod
    def none(cls) -> Self:
        """Return an instance without points."""
        return cls(np.zeros((0, 4), dtype=np.int64), np.zeros((0, 5, 5)))

    @classmethod
    def reassign(cls, fine: Level, coarse: Level, bands: Bands) -> Self:
        """Return the isolated points of a level; adapt the `coarse` level in place.

        That level must be the one of plain 2 × 2 aggregates.
        """
        place = np.concatenate(bands.run(coarse.size, _find, fine)).reshape(-1, 4)
        _move_coefficients(fine, place, coarse)
        red = place[place[:, :2].sum(axis=1) % 2 == 0]
        return cls(red, _patches(fine, red))

    def restrict(self, source: FloatArray, coarse: FloatArray) -> None:
        """Move the residual that plain aggregates summed in `coarse` to the new aggregates."""
        _restrict(self.place, self.patch, source, coarse)

    def correct(self, coarse: FloatArray, response: FloatArray) -> None:
        """Add to the smoothed `response` the change due to the new aggregates."""
        _correct(self.place, self.patch, coarse, response)


@compiled_inline
def _across(level: Level, i: int, j: int) -> tuple[float, float]:
    """Weight of the edges of (i, j) along its row: inside its aggregate, and out of it."""
    before, after = level.right[i, j - 1], level.right[i, j]
    return (after, before) if j % 2 == 1 else (before, after)


@compiled_inline
def _along(level: Level, i: int, j: int) -> tuple[float, float]:
    """Weight of the edges of (i, j) along its column: inside its aggregate, and out of it."""
    before, after = level.down[i - 1, j], level.down[i, j]
    return (after, before) if i % 2 == 1 else (before, after)


@compiled_inline
def _weight_inside(level: Level, i: int, j: int) -> float:
    """Return the weight of the edges of (i, j) inside its aggregate."""
    return _across(level, i, j)[0] + _along(level, i, j)[0]


@compiled_inline
def _out(i: int) -> int:
    """Direction out of the aggregate along one axis."""
    return -1 if i % 2 == 1 else 1


@compiled
def _find(level: Level, first: int, last: int) -> IntArray:
    """Isolated points in rows `first` … `last` − 1 of aggregates: rows of `place`, flat."""
    right, down, _ = level
    found = [0 for _ in range(0)]
    for i in range(2 * first + 1, min(2 * last + 1, right.shape[0] - 1)):
        inside, out = (down[i], down[i - 1]) if i % 2 == 1 else (down[i - 1], down[i])
        for pair in range(1, right.shape[1] - 1, 2):
            if right[i, pair] > 0:
                continue
            for j in range(pair, pair + 2):
                # Nearly all points have an edge inside, or none at all: the call is for the others.
                if inside[j] > 0 or right[i, j - 1] + right[i, j] + out[j] == 0:
                    continue
                if _is_reassigned(level, i, j):
                    sideways = _across(level, i, j)[1] >= _along(level, i, j)[1]
                    found.append(i)
                    found.append(j)
                    found.append((i + 1) // 2 + (0 if sideways else _out(i)))
                    found.append((j + 1) // 2 + (_out(j) if sideways else 0))
    return np.array(found)


@compiled
def _is_reassigned(level: Level, i: int, j: int) -> bool:
    """Whether (i, j) moves out of its aggregate: not if it is alone or the last one there."""
    if not _can_move(level, i, j):
        return False
    m, n = i - _out(i), j - _out(j)
    for a, b in ((m, n), (m, j), (i, n)):
        if _diagonal(level, a, b) > 0:
            later = a > i or (a == i and b > j)
            if later or not _can_move(level, a, b):
                return True
    return False


@compiled
def _can_move(level: Level, i: int, j: int) -> bool:
    """Whether (i, j) has no edge inside its aggregate, but edges to points that do not move.

    Two such points must be joined around the corner, no less strongly than by the edge that is
    given up.
    """
    across, along = _across(level, i, j)[1], _along(level, i, j)[1]
    if across + along == 0 or _weight_inside(level, i, j) > 0:
        return False
    a, b = i + _out(i), j + _out(j)
    if across > 0 and not _remains(level, i, b):
        return False
    if along > 0 and not _remains(level, a, j):
        return False
    if across == 0 or along == 0:
        return True
    around = min(_along(level, i, b)[1], _across(level, a, j)[1])
    return around >= min(across, along) and _remains(level, a, b)


@compiled
def _remains(level: Level, i: int, j: int) -> bool:
    """Whether (i, j) certainly does not move: it has an edge inside its aggregate, or is alone."""
    m, n = i - _out(i), j - _out(j)
    others = _diagonal(level, m, j) + _diagonal(level, i, n)
    alone = others + _diagonal(level, m, n) == 0
    return alone or _weight_inside(level, i, j) > 0


@compiled_inline
def _diagonal(level: Level, i: int, j: int) -> float:
    """Diagonal of the matrix at (i, j)."""
    right, down, ground = level
    return (right[i, j] + right[i, j - 1]) + (down[i, j] + down[i - 1, j]) + ground[i, j]


@compiled
def _move_coefficients(fine: Level, place: IntArray, coarse: Level) -> None:
    """Move the edges and constraints of isolated points to their new aggregates."""
    ground = fine.ground
    coarse_right, coarse_down, coarse_ground = coarse
    half = np.float32(0.5)
    for k in range(len(place)):
        i, j = place[k, 0], place[k, 1]
        r, c = (i + 1) // 2, (j + 1) // 2
        across, along = _across(fine, i, j)[1], _along(fine, i, j)[1]
        # An edge is stored at the first of its two points.
        above, left = r - (i % 2), c - (j % 2)
        coarse_right[r, left] = max(coarse_right[r, left] - half * across, 0)
        coarse_down[above, c] = max(coarse_down[above, c] - half * along, 0)
        coarse_right[r + _out(i), left] += min(across, along)
        coarse_down[above, c + _out(j)] += min(across, along)
        coarse_ground[r, c] = max(coarse_ground[r, c] - ground[i, j], 0)
        coarse_ground[place[k, 2], place[k, 3]] += ground[i, j]


@compiled
def _patches(level: Level, place: IntArray) -> FloatArray:
    """Black, then red smoothing of a unit at each of some red points (n, 5, 5)."""
    patch = np.zeros((len(place), 5, 5), dtype=level.right.dtype)
    for k in range(len(place)):
        i, j = place[k, 0], place[k, 1]
        for a, b in ((-1, 0), (0, -1), (0, 1), (1, 0)):
            black = _pull(level, i, j, i + a, j + b)
            patch[k, 2 + a, 2 + b] = black
            for c, d in ((-1, 0), (0, -1), (0, 1), (1, 0)):
                if black > 0:
                    red = _pull(level, i + a, j + b, i + a + c, j + b + d)
                    patch[k, 2 + a + c, 2 + b + d] += black * red
    return patch


@compiled_inline
def _pull(level: Level, i: int, j: int, m: int, n: int) -> float:
    """Return the change of the neighbour (m, n), when smoothed, for a unit at (i, j)."""
    right, down, _ = level
    weight = right[i, min(j, n)] if i == m else down[min(i, m), j]
    if weight == 0:
        return weight
    return weight / _diagonal(level, m, n)


@compiled
def _restrict(place: IntArray, patch: FloatArray, source: FloatArray, coarse: FloatArray) -> None:
    for k in range(len(place)):
        i, j = place[k, 0], place[k, 1]
        residual = np.float64(0.0)
        for a in range(5):
            for b in range(5):
                if patch[k, a, b] > 0:
                    residual += patch[k, a, b] * source[i + a - 2, j + b - 2]
        coarse[(i + 1) // 2, (j + 1) // 2] -= residual
        coarse[place[k, 2], place[k, 3]] += residual


@compiled
def _correct(place: IntArray, patch: FloatArray, coarse: FloatArray, response: FloatArray) -> None:
    for k in range(len(place)):
        i, j = place[k, 0], place[k, 1]
        step = coarse[place[k, 2], place[k, 3]] - coarse[(i + 1) // 2, (j + 1) // 2]
        for a in range(5):
            for b in range(5):
                if patch[k, a, b] > 0:
                    response[i + a - 2, j + b - 2] += patch[k, a, b] * step
