"""Parts of a height problem that no edge joins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray, IntArray
from spcola.heights.problem import HeightProblem
from spcola.kernel import kernel


@dataclass(frozen=True, eq=False)
class Components:
    """Connected parts of a height problem.

    Parameters
    ----------
    labels : (R, C) integer ndarray
        0 … K − 1 in the order of the first point of each part; −1 outside the mask.
    size : (K,) integer ndarray
        Points of each part.
    weight : (K,) ndarray
        Sum of the constraints' weights in each part, 1/m².
    """

    labels: IntArray
    size: IntArray
    weight: FloatArray

    @property
    def floating(self) -> IntArray:
        """Labels of the parts without any constraint: their mean height is free."""
        free: IntArray = np.flatnonzero(self.weight == 0)
        return free

    @property
    def is_floating(self) -> BoolArray:
        """Mask (R, C) of the points of floating parts."""
        inside: BoolArray = np.isin(self.labels, self.floating)
        return inside


def find_components(problem: HeightProblem) -> Components:
    """Label the parts of `problem` that edges of positive weight hold together."""
    labels = np.full(problem.shape, -1, dtype=np.int32)
    count = _flood(labels, problem.mask, problem.weight_x, problem.weight_y)
    inside = labels[problem.mask]
    size = np.bincount(inside, minlength=count)
    weight = np.bincount(inside, weights=problem.weight[problem.mask], minlength=count)
    return Components(labels, size, weight.astype(np.float64))


@kernel
def _flood(labels: AnyArray, mask: BoolArray, right: FloatArray, down: FloatArray) -> int:
    """Fill `labels` part by part (a stack of points still to visit); return how many parts."""
    rows, columns = mask.shape
    stack = np.empty(rows * columns, dtype=np.int64)
    count = 0
    for seed in range(rows * columns):
        r, c = seed // columns, seed % columns
        if not mask[r, c] or labels[r, c] >= 0:
            continue
        labels[r, c] = count
        stack[0] = seed
        top = 1
        while top > 0:
            top -= 1
            r, c = stack[top] // columns, stack[top] % columns
            if c + 1 < columns and right[r, c] > 0 and labels[r, c + 1] < 0:
                labels[r, c + 1] = count
                stack[top] = r * columns + c + 1
                top += 1
            if c > 0 and right[r, c - 1] > 0 and labels[r, c - 1] < 0:
                labels[r, c - 1] = count
                stack[top] = r * columns + c - 1
                top += 1
            if r + 1 < rows and down[r, c] > 0 and labels[r + 1, c] < 0:
                labels[r + 1, c] = count
                stack[top] = (r + 1) * columns + c
                top += 1
            if r > 0 and down[r - 1, c] > 0 and labels[r - 1, c] < 0:
                labels[r - 1, c] = count
                stack[top] = (r - 1) * columns + c
                top += 1
        count += 1
    return count
