"""Red–black Gauss–Seidel on one grid level of energy (A), row by row.

A level is a grid with a frame of one point without edges around it (R + 2, C + 2), in single
precision: the weights of the edges to the next column (`right`) and row (`down`), and of the
constraints (`ground`), each over one unit. Red are the points with an even sum of indices. Both
sweeps depend on the source only, so that a row of the response depends on five rows of it: a few
lines of memory that fit the cache suffice, memory is read once, and threads can work on different
bands of rows with the same result.

All points of a row are computed, whatever their colour: wasting half of the arithmetic is faster
than leaving gaps, because the loops remain vectorised. The values of a line of red at black points
are meaningless and unused, since the neighbours of a black point are red and of a red one black.
Colours are separated only where both meet in one row. For the same reason no loop names more than
nine arrays: the compiler has to check that outputs do not overlap inputs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spcola.arrays import FloatArray
from spcola.compilation import compiled, compiled_inline

_TINY = np.float32(1e-30)
"""Diagonal of points without edges; far below weights (1 at most)."""
_LINES = 4
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
LANES = 32
"""Parallel partial sums: a vectorised loop whose order does not depend on the threads."""


class Level(NamedTuple):
    """Weights of the edges to the next column and row, and of the constraints: (R + 2, C + 2)."""

    right: FloatArray
    down: FloatArray
    ground: FloatArray

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns without the frame."""
        return (self.right.shape[0] - 2, self.right.shape[1] - 2)


@compiled
def smooth_and_restrict(
    level: Level, source: FloatArray, coarse: FloatArray, first: int, last: int
) -> None:
    """Smooth from zero, red then black; sum the residual into rows `first` … `last` − 1.

    The rows are those of the coarser level. The residual at black points is 0.
    """
    right, down, ground = level
    rows, width = source.shape[0] - 2, source.shape[1]
    rest, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    red = np.zeros((_LINES, width), dtype=source.dtype)
    black, inverse = np.zeros_like(red), np.zeros_like(red)
    low, high = 2 * first + 1, min(2 * last, rows)
    for lead in range(low - 2, high + 3):
        k = lead % _LINES
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], inverse[k])
            _start(source[lead], inverse[k], red[k])
        else:
            red[k, :] = 0.0
        i = lead - 1
        if i >= low - 1:
            _turn_black(right, down, source, inverse, red, i, black)
        i = lead - 2
        if i >= low:
            _pull(right[i], down[i - 1], down[i], black, i, colour[i % 2], rest)
            if i % 2 == 0 or i == high:
                _sum_pairs(rest, coarse[(i + 1) // 2])
                rest[:] = 0.0


@compiled
def correct_and_smooth(
    level: Level,
    source: FloatArray,
    coarse: FloatArray,
    add: bool,
    response: FloatArray,
    first: int,
    last: int,
) -> None:
    """Rows `first` … `last` − 1 of the response: the sweep of above, `coarse` added, black, red.

    It is stored in `response` or, if `add`, added to it.
    """
    right, down, ground = level
    rows, width = source.shape[0] - 2, source.shape[1]
    line, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    wide, red = np.zeros_like(line), np.zeros((_LINES, width), dtype=source.dtype)
    black, inverse = np.zeros_like(red), np.zeros_like(red)
    low = first + 1
    for lead in range(low - 2, last + 3):
        k = lead % _LINES
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], inverse[k])
            _widen(coarse[(lead + 1) // 2], wide)
            _start_with(source[lead], inverse[k], wide, red[k])
        else:
            red[k, :] = 0.0
        i = lead - 1
        if i >= low - 1:
            _turn_black(right, down, source, inverse, red, i, black)
        i = lead - 2
        if i >= low:
            k = i % _LINES
            _relax(right[i], down[i - 1], down[i], source[i], inverse[k], black, i, line)
            _store(line, black[k], colour[i % 2], colour[1 - i % 2], add, response[i])


@compiled
def subtract_product(
    level: Level, value: FloatArray, source: FloatArray, first: int, last: int
) -> None:
    """Rows `first` … `last` − 1 of ``source −= A value``."""
    line = np.zeros(value.shape[1], dtype=value.dtype)
    for i in range(first + 1, last + 1):
        _product(level, value, i, line)
        rest = source[i]
        for j in range(len(rest)):
            rest[j] -= line[j]


@compiled
def multiply(level: Level, value: FloatArray, out: FloatArray, first: int, last: int) -> float:
    """Store rows `first` … `last` − 1 of ``A value``; return their share of ``valueᵀ A value``."""
    total = np.zeros(LANES)
    for i in range(first + 1, last + 1):
        _product(level, value, i, out[i])
        add_products(value[i], out[i], total)
    return total.sum()


@compiled_inline
def add_products(one: FloatArray, other: FloatArray, total: FloatArray) -> None:
    """Add the products of two rows to parallel partial sums in double precision."""
    whole = len(one) // LANES * LANES
    for first in range(0, whole, LANES):
        for j in range(LANES):
            total[j] += np.float64(one[first + j]) * other[first + j]
    for j in range(whole, len(one)):
        total[j - whole] += np.float64(one[j]) * other[j]


@compiled_inline
def _product(level: Level, value: FloatArray, i: int, out: FloatArray) -> None:
    """Row i of ``A value``, from differences: exact also where `ground` is weak."""
    right, above, below, ground = level.right[i], level.down[i - 1], level.down[i], level.ground[i]
    here, up, low = value[i], value[i - 1], value[i + 1]
    for j in range(1, len(out) - 1):
        out[j] = (
            ground[j] * here[j]
            + right[j] * (here[j] - here[j + 1])
            + right[j - 1] * (here[j] - here[j - 1])
        ) + (below[j] * (here[j] - low[j]) + above[j] * (here[j] - up[j]))


@compiled
def _colours(like: FloatArray) -> FloatArray:
    """1 at even columns and 0 at odd ones (row 0), and the reverse (row 1)."""
    colour = np.zeros((2, like.shape[1]), dtype=like.dtype)
    colour[0, 0::2] = 1.0
    colour[1, 1::2] = 1.0
    return colour


@compiled_inline
def _invert(
    right: FloatArray, above: FloatArray, below: FloatArray, ground: FloatArray, out: FloatArray
) -> None:
    """One over the diagonal of a row; 0 at points without weight.

    These are not only points outside the mask: on a coarse level a floating part is one of them,
    with rounding errors for a residual.
    """
    for j in range(1, len(out) - 1):
        diagonal = ground[j] + right[j] + right[j - 1] + above[j] + below[j]
        out[j] = _ONE / diagonal if diagonal > _TINY else _ZERO


@compiled_inline
def _start(source: FloatArray, inverse: FloatArray, out: FloatArray) -> None:
    for j in range(1, len(out) - 1):
        out[j] = source[j] * inverse[j]


@compiled_inline
def _start_with(source: FloatArray, inverse: FloatArray, wide: FloatArray, out: FloatArray) -> None:
    for j in range(1, len(out) - 1):
        out[j] = source[j] * inverse[j] + wide[j]


@compiled_inline
def _turn_black(
    right: FloatArray,
    down: FloatArray,
    source: FloatArray,
    inverse: FloatArray,
    red: FloatArray,
    i: int,
    black: FloatArray,
) -> None:
    """Solve the black points of row i, of the whole arrays, for given red ones."""
    k = i % _LINES
    if 1 <= i <= source.shape[0] - 2:
        _relax(right[i], down[i - 1], down[i], source[i], inverse[k], red, i, black[k])
    else:
        black[k, :] = 0.0


@compiled_inline
def _pull(
    right: FloatArray,
    above: FloatArray,
    below: FloatArray,
    lines: FloatArray,
    i: int,
    colour: FloatArray,
    out: FloatArray,
) -> None:
    """Add the weighted neighbours of row i at the points of one colour.

    Rows of `lines` are taken modulo their number.
    """
    here, up, low = lines[i % _LINES], lines[(i - 1) % _LINES], lines[(i + 1) % _LINES]
    for j in range(1, len(out) - 1):
        out[j] += colour[j] * (
            (right[j] * here[j + 1] + right[j - 1] * here[j - 1])
            + (above[j] * up[j] + below[j] * low[j])
        )


@compiled_inline
def _relax(
    right: FloatArray,
    above: FloatArray,
    below: FloatArray,
    source: FloatArray,
    inverse: FloatArray,
    lines: FloatArray,
    i: int,
    out: FloatArray,
) -> None:
    """Solve the points of row i for given neighbours, rows of `lines` modulo their number."""
    here, up, low = lines[i % _LINES], lines[(i - 1) % _LINES], lines[(i + 1) % _LINES]
    for j in range(1, len(out) - 1):
        out[j] = inverse[j] * (
            (source[j] + (right[j] * here[j + 1] + right[j - 1] * here[j - 1]))
            + (above[j] * up[j] + below[j] * low[j])
        )


@compiled_inline
def _sum_pairs(values: FloatArray, out: FloatArray) -> None:
    """Sum the two columns of each column of the coarser level."""
    for c in range(1, (len(values) + 1) // 2):
        out[c] = values[2 * c - 1] + values[2 * c]


@compiled_inline
def _widen(coarse: FloatArray, out: FloatArray) -> None:
    """Give both columns of each column of the coarser level its value."""
    for c in range(1, (len(out) + 1) // 2):
        out[2 * c - 1] = coarse[c]
        out[2 * c] = coarse[c]


@compiled_inline
def _store(
    one: FloatArray,
    other: FloatArray,
    colour: FloatArray,
    opposite: FloatArray,
    add: bool,
    out: FloatArray,
) -> None:
    """Store, or add, a row that is `one` at the points of `colour`, `other` at the rest."""
    if add:
        for j in range(1, len(out) - 1):
            out[j] += one[j] * colour[j] + other[j] * opposite[j]
    else:
        for j in range(1, len(out) - 1):
            out[j] = one[j] * colour[j] + other[j] * opposite[j]
