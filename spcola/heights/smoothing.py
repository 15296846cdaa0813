"""Red–black Gauss–Seidel on one grid level of energy (A), row by row.

A level is a grid with a frame of one point without edges around it (R + 2, C + 2), in single
precision: `right` and `down` are the weights of the edges to the next column and row, `ground`
those of the constraints. Red are the points with an even sum of indices. Both sweeps start from
nothing but the source, so that a row of the answer depends on five rows of it: rows follow one
another through a few lines of memory that fit the cache, memory is read once, and bands of rows
can be worked on by different threads with the same result.

All points of a row are computed and those of the other colour multiplied by 0: wasting half of
the arithmetic is faster than leaving gaps, because the loops stay vectorised. For the same
reason no loop names more than a few arrays: the compiler has to check that they do not overlap.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.kernel import kernel

_TINY = np.float32(1e-30)
"""Keeps points without edges from dividing by zero; far below weights (1 at most)."""
_LINES = 4
_ONE = np.float32(1.0)


@kernel
def smooth_and_restrict(
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    source: FloatArray,
    coarse: FloatArray,
    first: int,
    last: int,
) -> None:
    """Smooth from zero, red then black; sum what residual is left into rows `first` … `last` − 1.

    The rows are those of the coarser level. Black points have no residual left.
    """
    rows, width = source.shape[0] - 2, source.shape[1]
    inverse = np.zeros((_LINES, width), dtype=source.dtype)
    red, black = np.zeros_like(inverse), np.zeros_like(inverse)
    line, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    low, high = 2 * first + 1, min(2 * last, rows)
    for lead in range(low - 2, high + 3):
        k = lead % _LINES
        red[k, :] = 0.0
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], inverse[k])
            _start(source[lead], inverse[k], colour[lead % 2], red[k])
        i = lead - 1
        if i >= low - 1:
            black[i % _LINES, :] = 0.0
        if i >= low - 1 and 1 <= i <= rows:
            _gather(right[i], down[i - 1], down[i], red, i, line)
            _relax(source[i], line, inverse[i % _LINES], colour[(i + 1) % 2], black[i % _LINES])
        i = lead - 2
        if i >= low:
            if i % 2 == 1:
                coarse[(i + 1) // 2, :] = 0.0
            _gather(right[i], down[i - 1], down[i], black, i, line)
            _sum_pairs(line, colour[i % 2], coarse[(i + 1) // 2])


@kernel
def correct_and_smooth(  # noqa: PLR0913, PLR0917  flat arguments: numba knows no dataclasses
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    source: FloatArray,
    coarse: FloatArray,
    add: bool,
    answer: FloatArray,
    first: int,
    last: int,
) -> None:
    """Rows `first` … `last` − 1 of the answer: the sweep of above, `coarse` added, black, red.

    It is stored in `answer` or, if `add`, added to it.
    """
    rows, width = source.shape[0] - 2, source.shape[1]
    inverse = np.zeros((_LINES, width), dtype=source.dtype)
    red, black = np.zeros_like(inverse), np.zeros_like(inverse)
    line, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    wide = np.zeros(width, dtype=source.dtype)
    low = first + 1
    for lead in range(low - 2, last + 3):
        k = lead % _LINES
        red[k, :] = 0.0
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], inverse[k])
            _start(source[lead], inverse[k], colour[lead % 2], red[k])
            _spread(coarse[(lead + 1) // 2], wide)
            _add(wide, colour[lead % 2], red[k])
        i = lead - 1
        if i >= low - 1:
            black[i % _LINES, :] = 0.0
        if i >= low - 1 and 1 <= i <= rows:
            _gather(right[i], down[i - 1], down[i], red, i, line)
            _relax(source[i], line, inverse[i % _LINES], colour[(i + 1) % 2], black[i % _LINES])
        i = lead - 2
        if i >= low:
            _gather(right[i], down[i - 1], down[i], black, i, line)
            _relax(source[i], line, inverse[i % _LINES], colour[i % 2], wide)
            _store(black[i % _LINES], wide, add, answer[i])


@kernel
def subtract_product(
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    value: FloatArray,
    source: FloatArray,
    first: int,
    last: int,
) -> None:
    """Rows `first` … `last` − 1 of ``source −= A value``."""
    line = np.zeros(value.shape[1], dtype=source.dtype)
    for i in range(first + 1, last + 1):
        _product(right[i], down, ground[i], value, i, line)
        out = source[i]
        for j in range(1, len(line) - 1):
            out[j] -= line[j]


@kernel
def multiply(
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    value: FloatArray,
    out: FloatArray,
    first: int,
    last: int,
) -> float:
    """Rows `first` … `last` − 1 of ``A value``; return their share of ``valueᵀ A value``."""
    total = np.zeros(value.shape[1])
    for i in range(first + 1, last + 1):
        _product(right[i], down, ground[i], value, i, out[i])
        here, there = value[i], out[i]
        for j in range(1, len(total) - 1):
            total[j] += np.float64(here[j]) * there[j]
    return total.sum()


@kernel
def _product(
    right: FloatArray,
    down: FloatArray,
    ground: FloatArray,
    value: FloatArray,
    i: int,
    out: FloatArray,
) -> None:
    """Row i of ``A value``, from differences: exact also where `ground` is weak."""
    here, up, low, above, below = value[i], value[i - 1], value[i + 1], down[i - 1], down[i]
    for j in range(1, len(out) - 1):
        out[j] = (
            ground[j] * here[j]
            + right[j] * (here[j] - here[j + 1])
            + right[j - 1] * (here[j] - here[j - 1])
        )
    for j in range(1, len(out) - 1):
        out[j] += below[j] * (here[j] - low[j]) + above[j] * (here[j] - up[j])


@kernel
def _colours(like: FloatArray) -> FloatArray:
    """1 at even columns and 0 at odd ones (row 0), and the reverse (row 1)."""
    colour = np.zeros((2, like.shape[1]), dtype=like.dtype)
    colour[0, 0::2] = 1.0
    colour[1, 1::2] = 1.0
    return colour


@kernel
def _invert(
    right: FloatArray, above: FloatArray, below: FloatArray, ground: FloatArray, out: FloatArray
) -> None:
    """One over the diagonal of a row; huge where there is nothing, which only meets zeros."""
    for j in range(1, len(out) - 1):
        out[j] = _ONE / (ground[j] + right[j] + right[j - 1] + above[j] + below[j] + _TINY)


@kernel
def _start(source: FloatArray, inverse: FloatArray, colour: FloatArray, out: FloatArray) -> None:
    for j in range(1, len(out) - 1):
        out[j] = source[j] * inverse[j] * colour[j]


@kernel
def _gather(
    right: FloatArray,
    above: FloatArray,
    below: FloatArray,
    lines: FloatArray,
    i: int,
    out: FloatArray,
) -> None:
    """What the neighbours of row i pull with; rows of `lines` are taken modulo their number."""
    here, up, down = lines[i % _LINES], lines[(i - 1) % _LINES], lines[(i + 1) % _LINES]
    for j in range(1, len(out) - 1):
        out[j] = right[j] * here[j + 1] + right[j - 1] * here[j - 1]
    for j in range(1, len(out) - 1):
        out[j] += above[j] * up[j] + below[j] * down[j]


@kernel
def _relax(
    source: FloatArray, pull: FloatArray, inverse: FloatArray, colour: FloatArray, out: FloatArray
) -> None:
    for j in range(1, len(out) - 1):
        out[j] = (source[j] + pull[j]) * inverse[j] * colour[j]


@kernel
def _sum_pairs(values: FloatArray, colour: FloatArray, out: FloatArray) -> None:
    """Add the values of one colour, two columns at a time, to the row of the coarser level."""
    for j in range(1, len(values) - 1):
        values[j] *= colour[j]
    pairs = (len(values) - 2) // 2
    for c in range(1, pairs + 1):
        out[c] += values[2 * c - 1] + values[2 * c]
    if len(values) % 2 == 1:
        out[pairs + 1] += values[len(values) - 2]


@kernel
def _spread(coarse: FloatArray, out: FloatArray) -> None:
    """Give each pair of columns the value of the coarser level."""
    pairs = (len(out) - 2) // 2
    for c in range(1, pairs + 1):
        out[2 * c - 1] = coarse[c]
        out[2 * c] = coarse[c]
    if len(out) % 2 == 1:
        out[len(out) - 2] = coarse[pairs + 1]


@kernel
def _add(values: FloatArray, colour: FloatArray, out: FloatArray) -> None:
    for j in range(1, len(out) - 1):
        out[j] += values[j] * colour[j]


@kernel
def _store(black: FloatArray, red: FloatArray, add: bool, out: FloatArray) -> None:
    if add:
        for j in range(1, len(out) - 1):
            out[j] += black[j] + red[j]
    else:
        for j in range(1, len(out) - 1):
            out[j] = black[j] + red[j]
