"""Vector kernels of the conjugate gradients: bands of rows, single precision, exact sums.

Rows `first` … `last` − 1 count without the frame. Sums are taken down the columns first: such
loops are vectorised as they stand, and the order of additions does not depend on threads.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel


@kernel
def residual(  # noqa: PLR0913, PLR0917  flat arguments: numba knows no dataclasses
    step_x: FloatArray,
    step_y: FloatArray,
    weight_x: FloatArray,
    weight_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    pulls: FloatArray,
    x: FloatArray,
    unit: float,
    out: FloatArray,
    first: int,
    last: int,
) -> None:
    """Residual of the normal equations over `unit` into the padded `out`.

    Summed from misfits in double precision: exact also far from zero height. `pulls` is what
    means pull with: (R, C), or without elements if there are none.
    """
    rows, columns = x.shape
    line, pull = np.zeros(columns), np.zeros(columns)
    for r in range(first, last):
        for c in range(columns):
            misfit = height[r, c] - x[r, c]
            line[c] = weight[r, c] * misfit if weight[r, c] > 0 else 0.0
        if pulls.size > 0:
            for c in range(columns):
                line[c] += pulls[r, c]
        for c in range(columns - 1):
            pull[c] = weight_x[r, c] * (step_x[r, c] - (x[r, c + 1] - x[r, c]))
        for c in range(columns - 1):
            line[c] -= pull[c]
        for c in range(1, columns):
            line[c] += pull[c - 1]
        if r > 0:
            for c in range(columns):
                line[c] += weight_y[r - 1, c] * (step_y[r - 1, c] - (x[r, c] - x[r - 1, c]))
        if r + 1 < rows:
            for c in range(columns):
                line[c] -= weight_y[r, c] * (step_y[r, c] - (x[r + 1, c] - x[r, c]))
        inverse = 1.0 / unit
        target = out[r + 1]
        for c in range(columns):
            target[c + 1] = line[c] * inverse


@kernel
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


@kernel
def turn(p: FloatArray, z: FloatArray, beta: float, first: int, last: int) -> None:
    """``p = z + β p``: the next direction."""
    factor = p.dtype.type(beta)
    for i in range(first + 1, last + 1):
        direction, answer = p[i], z[i]
        for j in range(len(direction)):
            direction[j] = answer[j] + factor * direction[j]


@kernel
def product_and_largest(r: FloatArray, z: FloatArray, first: int, last: int) -> tuple[float, float]:
    """Return the share of ``rᵀ z`` and the largest ``|z|``."""
    total = np.zeros(r.shape[1])
    largest = np.zeros(r.shape[1], dtype=z.dtype)
    for i in range(first + 1, last + 1):
        here, there = r[i], z[i]
        for j in range(len(total)):
            total[j] += np.float64(here[j]) * there[j]
        for j in range(len(total)):
            largest[j] = max(largest[j], abs(there[j]))
    return total.sum(), largest.max()


@kernel
def sum_parts(labels: IntArray, parts: int, r: FloatArray, first: int, last: int) -> FloatArray:
    """Return the sum of `r` over each part (K,), of these rows."""
    total = np.zeros(parts)
    for i in range(first, last):
        label, row = labels[i], r[i + 1]
        before, run = -1, 0.0
        for j in range(len(label)):
            if label[j] != before:
                if before >= 0:
                    total[before] += run
                before, run = label[j], 0.0
            run += row[j + 1]
        if before >= 0:
            total[before] += run
    return total


@kernel
def lift_parts(labels: IntArray, shift: FloatArray, z: FloatArray, first: int, last: int) -> None:
    """Add the shift (K,) of each part to `z`."""
    for i in range(first, last):
        label, row = labels[i], z[i + 1]
        for j in range(len(label)):
            if label[j] >= 0:
                row[j + 1] += shift[label[j]]
