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
    line, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    red = np.zeros((_LINES, width), dtype=source.dtype)
    black, red_inverse, black_inverse = np.zeros_like(red), np.zeros_like(red), np.zeros_like(red)
    low, high = 2 * first + 1, min(2 * last, rows)
    for lead in range(low - 2, high + 3):
        k = lead % _LINES
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], line)
            _colour(line, colour[lead % 2], red_inverse[k], black_inverse[k])
            _start(source[lead], red_inverse[k], red[k])
        else:
            red[k, :] = 0.0
        i = lead - 1
        if i >= low - 1 and 1 <= i <= rows:
            k = i % _LINES
            _relax(right[i], down[i - 1], down[i], source[i], black_inverse[k], red, i, black[k])
        elif i >= low - 1:
            black[i % _LINES, :] = 0.0
        i = lead - 2
        if i >= low:
            if i % 2 == 1:
                coarse[(i + 1) // 2, :] = 0.0
            _pull(right[i], down[i - 1], down[i], black, i, line)
            _sum_red(line, (i + 1) % 2, coarse[(i + 1) // 2])


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
    line, colour = np.zeros(width, dtype=source.dtype), _colours(source)
    red = np.zeros((_LINES, width), dtype=source.dtype)
    black, red_inverse, black_inverse = np.zeros_like(red), np.zeros_like(red), np.zeros_like(red)
    low = first + 1
    for lead in range(low - 2, last + 3):
        k = lead % _LINES
        if 1 <= lead <= rows:
            _invert(right[lead], down[lead - 1], down[lead], ground[lead], line)
            _colour(line, colour[lead % 2], red_inverse[k], black_inverse[k])
            _start(source[lead], red_inverse[k], red[k])
            _add_to_red(coarse[(lead + 1) // 2], (lead + 1) % 2, red[k])
        else:
            red[k, :] = 0.0
        i = lead - 1
        if i >= low - 1 and 1 <= i <= rows:
            k = i % _LINES
            _relax(right[i], down[i - 1], down[i], source[i], black_inverse[k], red, i, black[k])
        elif i >= low - 1:
            black[i % _LINES, :] = 0.0
        i = lead - 2
        if i >= low:
            k = i % _LINES
            _relax(right[i], down[i - 1], down[i], source[i], red_inverse[k], black, i, line)
            _store(black[k], line, add, answer[i])


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
def _colour(inverse: FloatArray, colour: FloatArray, red: FloatArray, black: FloatArray) -> None:
    """Part a row into its red points (`colour` 1) and its black ones, 0 in between."""
    for j in range(1, len(inverse) - 1):
        red[j] = inverse[j] * colour[j]
        black[j] = inverse[j] - red[j]


@kernel
def _start(source: FloatArray, inverse: FloatArray, out: FloatArray) -> None:
    for j in range(1, len(out) - 1):
        out[j] = source[j] * inverse[j]


@kernel
def _pull(
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
        out[j] = (right[j] * here[j + 1] + right[j - 1] * here[j - 1]) + (
            above[j] * up[j] + below[j] * down[j]
        )


@kernel
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
    """Solve the points of row i where `inverse` is not 0 for given neighbours."""
    _pull(right, above, below, lines, i, out)
    for j in range(1, len(out) - 1):
        out[j] = (source[j] + out[j]) * inverse[j]


@kernel
def _sum_red(values: FloatArray, odd: int, out: FloatArray) -> None:
    """Add to the row of the coarser level: one of its two columns is red, the second if `odd`."""
    for c in range(1, (len(values) + 1 - odd) // 2):
        out[c] += values[2 * c - 1 + odd]


@kernel
def _add_to_red(coarse: FloatArray, odd: int, out: FloatArray) -> None:
    """Add a row of the coarser level to the red points of a row."""
    for c in range(1, (len(out) + 1 - odd) // 2):
        out[2 * c - 1 + odd] += coarse[c]


@kernel
def _store(black: FloatArray, red: FloatArray, add: bool, out: FloatArray) -> None:
    if add:
        for j in range(1, len(out) - 1):
            out[j] += black[j] + red[j]
    else:
        for j in range(1, len(out) - 1):
            out[j] = black[j] + red[j]
