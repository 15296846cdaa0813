"""Connected parts of a height problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import Bands, compiled
from spcola.heights.means import Sets
from spcola.heights.problem import HeightProblem

Grid = tuple[BoolArray, FloatArray, FloatArray]
"""The mask of a problem, and the weights of its edges to the next column and row."""


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
        Sum of the constraints' weights in each part, 1/m²: its stiffness against a shift.
    """

    labels: IntArray
    size: IntArray
    weight: FloatArray

    @property
    def floating(self) -> IntArray:
        """Labels of the parts without any constraint: their mean height is free."""
        return np.flatnonzero(self.weight == 0)

    @property
    def is_floating(self) -> BoolArray:
        """Mask (R, C) of the points of floating parts."""
        if len(self.floating) == 0:
            return np.zeros(self.labels.shape, dtype=bool)
        return np.append(self.weight == 0, False)[self.labels]

    @property
    def points(self) -> int:
        """Points of the mask."""
        return int(self.size.sum())

    def stiffness(self, problem: HeightProblem, weight: FloatArray) -> FloatArray:
        """Return the stiffness (K,) of each part: of point `weight` (R, C) and the means, 1/m²."""
        total = self.sums(weight)
        if problem.means is not None:
            means = problem.means
            whole = np.bincount(means.owner, means.share, len(means.height))
            part = self.labels.ravel()[means.points[means.start[:-1]]]
            total += np.bincount(part, means.weight * whole**2, len(total))
        return total

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sum (K,) of `values` (R, C) over each part; only positive values count."""
        total = np.zeros(len(self.size))
        _sum_parts(self.labels, values, total)
        return total


def find_components(problem: HeightProblem, bands: Bands | None = None) -> Components:
    """Label the parts of `problem` that edges of positive weight, or means, connect.

    Where only a mean connects two pieces, their relative height follows from the means and the
    other constraints, and from the first guess if these do not determine it. `bands` are the
    threads to use; one if not given.
    """
    mask, right = problem.mask, problem.weight_x
    grid = (mask, right, problem.weight_y)
    used = Bands(mask.size, threads=1) if bands is None else bands
    counts = used.run(problem.shape, _count_runs, mask, right)
    firsts = np.array([first for first, _ in used.cut(*problem.shape)])
    base = np.zeros(problem.shape[0], dtype=np.int64)
    base[firsts[1:]] = np.cumsum(counts)[:-1]
    parent = np.empty(sum(counts), dtype=np.int64)
    used.run(problem.shape, _join_runs, grid, base, parent)
    _join_bands(grid, base, firsts, parent)
    if problem.means is not None:
        _join_sets(mask, right, problem.means.sets, parent)
    number, count = _number(parent)
    labels = np.empty(problem.shape, dtype=np.int8 if count <= np.iinfo(np.int8).max else np.int32)
    used.run(problem.shape, _label, mask, right, base, number, labels)
    size = np.zeros(count, dtype=np.int64)
    _count_points(labels, size)
    parts = Components(labels, size, np.zeros(count))
    parts.weight[...] = parts.stiffness(problem, problem.weight)
    return parts


@compiled
def _count_runs(mask: BoolArray, right: FloatArray, first: int, last: int) -> int:
    """Runs of points that edges join along their row."""
    columns = mask.shape[1]
    count = 0
    for r in range(first, last):
        count += mask[r, 0]
        for c in range(1, columns):
            count += mask[r, c] & (right[r, c - 1] == 0)
    return count


@compiled
def _join_runs(grid: Grid, base: IntArray, parent: IntArray, first: int, last: int) -> None:
    """Fill `parent` with a forest over the runs: those of one part have one root, its first run.

    Each band of rows has trees of its own; `base` is the number of the first run of each.
    """
    mask, right, _ = grid
    columns = mask.shape[1]
    above, here = np.empty((2, columns), dtype=np.int64)
    count = base[first]
    for r in range(first, last):
        above, here = here, above
        for c in range(columns):
            if mask[r, c] and (c == 0 or right[r, c - 1] == 0):
                parent[count] = count
                count += 1
            here[c] = count - 1
        if r > first:
            _join_rows(grid, r, above, here, parent)


@compiled
def _join_bands(grid: Grid, base: IntArray, firsts: IntArray, parent: IntArray) -> None:
    """Join the runs of the first row of each band with those of the row above it."""
    mask, right, _ = grid
    columns = mask.shape[1]
    above, here = np.empty((2, columns), dtype=np.int64)
    for r in firsts[1:]:
        run = base[r] - _count_runs(mask, right, r - 1, r) - 1
        for c in range(columns):
            run += mask[r - 1, c] and (c == 0 or right[r - 1, c - 1] == 0)
            above[c] = run
        for c in range(columns):
            run += mask[r, c] and (c == 0 or right[r, c - 1] == 0)
            here[c] = run
        _join_rows(grid, r, above, here, parent)


@compiled
def _join_rows(grid: Grid, r: int, above: IntArray, here: IntArray, parent: IntArray) -> None:
    """Join the runs of row r, by their numbers at each point, with those of the row above it."""
    mask, right, down = grid
    for c in range(mask.shape[1]):
        if not mask[r, c] or down[r - 1, c] == 0:
            continue
        # Next to a joint of the same two runs there is nothing new to join.
        if c > 0 and right[r, c - 1] > 0 and right[r - 1, c - 1] > 0 and down[r - 1, c - 1] > 0:
            continue
        a, b = _root(parent, above[c]), _root(parent, here[c])
        parent[max(a, b)] = min(a, b)


@compiled
def _join_sets(mask: BoolArray, right: FloatArray, sets: Sets, parent: IntArray) -> None:
    """Join the runs that the points of one set lie in."""
    start, points, _ = sets
    rows, columns = mask.shape
    runs = np.empty((rows, columns), dtype=np.int64)
    run = -1
    for r in range(rows):
        for c in range(columns):
            run += mask[r, c] and (c == 0 or right[r, c - 1] == 0)
            runs[r, c] = run
    for k in range(len(start) - 1):
        for n in range(start[k] + 1, start[k + 1]):
            a = _root(parent, runs.flat[points[n - 1]])
            b = _root(parent, runs.flat[points[n]])
            parent[max(a, b)] = min(a, b)


@compiled
def _root(parent: IntArray, run: int) -> int:
    """Root of a run; the path is shortened for later calls."""
    while parent[run] != run:
        parent[run] = parent[parent[run]]
        run = parent[run]
    return run


@compiled
def _number(parent: IntArray) -> tuple[IntArray, int]:
    """Number the parts in the order of their first runs: (label of each run, parts)."""
    number = np.empty_like(parent)
    count = 0
    for run in range(len(parent)):
        if parent[run] == run:
            number[run] = count
            count += 1
        else:
            # A root is the smallest run of its part, so that it has its label already.
            number[run] = number[_root(parent, run)]
    return number, count


@compiled
def _label(
    mask: BoolArray,
    right: FloatArray,
    base: IntArray,
    number: IntArray,
    labels: IntArray,
    first: int,
    last: int,
) -> None:
    columns = mask.shape[1]
    run = base[first] - 1
    for r in range(first, last):
        for c in range(columns):
            if not mask[r, c]:
                labels[r, c] = -1
                continue
            if c == 0 or right[r, c - 1] == 0:
                run += 1
            labels[r, c] = number[run]


@compiled
def _count_points(labels: IntArray, size: IntArray) -> None:
    rows, columns = labels.shape
    for r in range(rows):
        before, run = -1, 0
        for c in range(columns):
            if labels[r, c] != before:
                if before >= 0:
                    size[before] += run
                before, run = labels[r, c], 0
            run += 1
        if before >= 0:
            size[before] += run


@compiled
def _sum_parts(labels: IntArray, values: FloatArray, total: FloatArray) -> None:
    rows, columns = labels.shape
    for r in range(rows):
        for c in range(columns):
            if labels[r, c] >= 0 and values[r, c] > 0:
                total[labels[r, c]] += values[r, c]
