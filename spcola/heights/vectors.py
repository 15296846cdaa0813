"""Vector kernels of the conjugate gradients: bands of rows, single precision, exact sums.

Rows `first` … `last` − 1 do not count the frame. Sums run down the columns first: such loops are
vectorised, and the order of additions does not depend on threads.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.heights.smoothing import LANES, add_products

Parts = tuple[IntArray, IntArray]
"""The part of each point (R, C), and the result of :func:`find_spans`."""


@compiled
def residual(
    edges: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    constraints: tuple[FloatArray, FloatArray],
    pulls: FloatArray,
    x: FloatArray,
    unit: float,
    out: FloatArray,
    first: int,
    last: int,
) -> None:
    """Residual of the normal equations over `unit` into the padded `out`.

    Summed from misfits in double precision: exact also far from zero height. `edges` are steps
    along x and y and their weights, `constraints` heights and their weights; `pulls` is the
    contribution of the means: (R, C), or without elements if there are none.
    """
    step_x, step_y, weight_x, weight_y = edges
    height, weight = constraints
    rows, columns = x.shape
    along, forces = np.zeros(columns + 1), np.zeros(columns)
    above, below = np.zeros(columns), np.zeros(columns)
    if first > 0:
        _misfits(step_y[first - 1], weight_y[first - 1], x[first - 1], x[first], below)
    for r in range(first, last):
        above, below = below, above
        if r + 1 < rows:
            _misfits(step_y[r], weight_y[r], x[r], x[r + 1], below)
        else:
            below[:] = 0.0
        _misfits(step_x[r], weight_x[r], x[r], x[r, 1:], along[1:])
        _constraints(height[r], weight[r], x[r], forces)
        if pulls.size > 0:
            for c in range(columns):
                forces[c] += pulls[r, c]
        _gather(forces, along, above, below, 1.0 / unit, out[r + 1])


@compiled_inline
def _misfits(
    steps: FloatArray, weights: FloatArray, here: FloatArray, there: FloatArray, out: FloatArray
) -> None:
    """Weighted residuals of edges: added at the far point, subtracted at the near one."""
    for c in range(len(steps)):
        out[c] = weights[c] * (steps[c] - (there[c] - here[c]))


@compiled_inline
def _constraints(height: FloatArray, weight: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Weighted residuals of the constraints of a row; heights without weight may be NaN."""
    for c in range(len(x)):
        misfit = height[c] - x[c]
        out[c] = weight[c] * misfit if weight[c] > 0 else 0.0


@compiled_inline
def _gather(
    forces: FloatArray,
    along: FloatArray,
    above: FloatArray,
    below: FloatArray,
    factor: float,
    out: FloatArray,
) -> None:
    for c in range(len(forces)):
        edges = (along[c] - along[c + 1]) + (above[c] - below[c])
        out[c + 1] = (forces[c] + edges) * factor


@compiled
def step(
    x: FloatArray,
    r: FloatArray,
    p: FloatArray,
    q: FloatArray,
    alpha: float,
    first: int,
    last: int,
) -> None:
    """``x += α p`` (R, C), ``r −= α q`` (padded)."""
    factor = r.dtype.type(alpha)
    for i in range(first, last):
        height, direction = x[i], p[i + 1]
        for j in range(len(height)):
            height[j] += alpha * direction[j + 1]
        rest, image = r[i + 1], q[i + 1]
        for j in range(len(rest)):
            rest[j] -= factor * image[j]


@compiled
def copy(p: FloatArray, z: FloatArray, first: int, last: int) -> None:
    """``p = z``: the first direction."""
    for i in range(first + 1, last + 1):
        direction, response = p[i], z[i]
        for j in range(len(direction)):
            direction[j] = response[j]


@compiled
def turn(p: FloatArray, z: FloatArray, beta: float, first: int, last: int) -> None:
    """``p = z + β p``: the next direction."""
    factor = p.dtype.type(beta)
    for i in range(first + 1, last + 1):
        direction, response = p[i], z[i]
        for j in range(len(direction)):
            direction[j] = response[j] + factor * direction[j]


@compiled
def product_and_largest(r: FloatArray, z: FloatArray, first: int, last: int) -> tuple[float, float]:
    """Return the share of ``rᵀ z`` and the largest ``|z|``."""
    total = np.zeros(LANES)
    largest = np.zeros(r.shape[1], dtype=z.dtype)
    for i in range(first + 1, last + 1):
        add_products(r[i], z[i], total)
        there = z[i]
        for j in range(len(largest)):
            largest[j] = max(largest[j], abs(there[j]))
    return total.sum(), largest.max()


@compiled
def find_spans(labels: IntArray, chosen: BoolArray) -> IntArray:
    """Return the first column and that after the last (R, 2) with points of the chosen parts."""
    rows, columns = labels.shape
    spans = np.zeros((rows, 2), dtype=np.int64)
    for i in range(rows):
        for j in range(columns):
            if labels[i, j] >= 0 and chosen[labels[i, j]]:
                if spans[i, 1] == 0:
                    spans[i, 0] = j
                spans[i, 1] = j + 1
    return spans


@compiled
def sum_parts(
    parts: Parts,
    count: int,
    r: FloatArray,
    ground: FloatArray,
    z: FloatArray,
    first: int,
    last: int,
) -> FloatArray:
    """Return the sum of ``r − ground z`` over each part (K,) within the spans of these rows."""
    labels, spans = parts
    total = np.zeros(count)
    for i in range(first, last):
        label, row, weight, response = labels[i], r[i + 1], ground[i + 1], z[i + 1]
        before, run = -1, 0.0
        for j in range(spans[i, 0], spans[i, 1]):
            if label[j] != before:
                if before >= 0:
                    total[before] += run
                before, run = label[j], 0.0
            run += row[j + 1] - weight[j + 1] * response[j + 1]
        if before >= 0:
            total[before] += run
    return total


@compiled
def shift_parts(parts: Parts, shift: FloatArray, z: FloatArray, first: int, last: int) -> None:
    """Add the shift (K,) of each part to `z` within the spans of these rows."""
    labels, spans = parts
    for i in range(first, last):
        label, row = labels[i], z[i + 1]
        for j in range(spans[i, 0], spans[i, 1]):
            if label[j] >= 0:
                row[j + 1] += shift[label[j]]


@compiled
def balance_parts(
    parts: Parts,
    shift: FloatArray,
    ground: FloatArray,
    x: FloatArray,
    r: FloatArray,
    first: int,
    last: int,
) -> None:
    """Add the shift (K,) of each part to `x`, and its effect to the residual `r`."""
    labels, spans = parts
    for i in range(first, last):
        label, height, weight, row = labels[i], x[i], ground[i + 1], r[i + 1]
        for j in range(spans[i, 0], spans[i, 1]):
            if label[j] >= 0:
                height[j] += shift[label[j]]
                row[j + 1] -= weight[j + 1] * shift[label[j]]
