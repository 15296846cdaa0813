"""A multigrid cycle for energy (A), used as the preconditioner of conjugate gradients.

Each level aggregates 2 × 2 points of the finer one, except for isolated points, which have no edge
to the others of their aggregate (`isolated_points`). With the piecewise-constant prolongation P,
the exact coarse matrix of the steps, ``PᵀLP``, is twice as stiff to smooth surfaces as it should
be, so the coarse edges are *halved*; the constraints are only summed, so that constants are
represented exactly.

Why the cycle is always positive definite, whatever weights, holes and islands: the coarse
matrix is at least ½ PᵀAP, so an exact coarse correction has eigenvalues in [0, 2] (in the energy
norm) and never makes an error grow; the smoothing before and after makes every error shrink
strictly; and two such cycles in a row on the coarser level (the W) have eigenvalues in (0, 1]
of the exact coarse solution again. A V-cycle would not have this property.

Everything is in single precision: conjugate gradients correct its errors, and the run time is
memory traffic.
"""

from __future__ import annotations

import itertools

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import Bands, compiled
from spcola.heights.isolated_points import IsolatedPoints
from spcola.heights.problem import HeightProblem
from spcola.heights.smoothing import (
    Level,
    correct_and_smooth,
    smooth_and_restrict,
    subtract_product,
)

_COARSEST_POINTS = 64
"""Levels up to this size are solved by their inverse: calls cost more than arithmetic there."""
_FREE = 1e-13
"""Pivots of that level, relative to its diagonal, that count as a rounded 0."""
_SERIAL_POINTS = 100_000
"""Levels up to this size run in one thread and one call, unless they have isolated points."""
_ISOLATED_LEVELS = 2
"""Levels whose isolated points are moved: by experiment, coarser levels do not need it."""


class Hierarchy:
    """All levels of a height problem, and one W-cycle over them.

    Not to be shared between threads: the cycle writes to memory of its own.

    Parameters
    ----------
    problem : HeightProblem
        Its steps and heights are not used.
    ground : (R, C) ndarray
        Constraint weights, 1/m².
    unit : float
        What all weights are divided by, 1/m².
    kind : type
        Precision of the coefficients and of the vectors that :meth:`apply` takes.
    bands : Bands
        The threads that set up the levels.
    """

    def __init__(
        self,
        problem: HeightProblem,
        ground: FloatArray,
        unit: float,
        kind: type[np.float32 | np.float64],
        bands: Bands,
    ) -> None:
        sizes = [problem.shape]
        while sizes[-1][0] * sizes[-1][1] > _COARSEST_POINTS:
            rows, columns = sizes[-1]
            sizes.append(((rows + 1) // 2, (columns + 1) // 2))
        padded = [(rows + 2) * (columns + 2) for rows, columns in sizes]
        self._sizes = np.array(sizes, dtype=np.int64)
        self._start = np.concatenate([[0], np.cumsum(padded)]).astype(np.int64)
        self._coefficients = np.zeros((3, self._start[-1]), dtype=kind)
        self.levels = [self._level(k) for k in range(len(sizes))]
        # The finest level uses the caller's vectors: its part here is never touched, and the system
        # allocates no memory for it.
        self._value, self._source = np.zeros((2, self._start[-1]), dtype=kind)
        self._fill(problem, ground, unit, bands)

    @property
    def finest(self) -> Level:
        """The level of the problem itself."""
        return self.levels[0]

    def apply(self, residual: FloatArray, response: FloatArray, bands: Bands) -> None:
        """Store the cycle's response to `residual` (both padded, single precision)."""
        self._cycle(0, residual, response, False, bands)

    def _level(self, k: int) -> Level:
        span, shape = slice(self._start[k], self._start[k + 1]), self._sizes[k] + 2
        return Level(*(each[span].reshape(shape) for each in self._coefficients))

    def _vectors(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Value and source of a level below the finest."""
        span, shape = slice(self._start[k], self._start[k + 1]), self._sizes[k] + 2
        return self._value[span].reshape(shape), self._source[span].reshape(shape)

    def _fill(self, problem: HeightProblem, ground: FloatArray, unit: float, bands: Bands) -> None:
        """Set the finest level, and each coarser one from the one above it."""
        fine = self.finest
        for values, out in (
            (problem.weight_x, fine.right),
            (problem.weight_y, fine.down),
            (ground, fine.ground),
        ):
            bands.run(fine.size, _convert, values, 1.0 / unit, out)
        self._isolated = [IsolatedPoints.none()] * len(self.levels)
        for k, (above, below) in enumerate(itertools.pairwise(self.levels)):
            bands.run(below.size, _coarsen, above, below)
            if k < min(_ISOLATED_LEVELS, len(self.levels) - 2):
                self._isolated[k] = IsolatedPoints.reassign(above, below, bands)
        last = self.levels[-1]
        self._inverse = _invert(last)
        apart = [
            k
            for k, level in enumerate(self.levels[:-2])
            if level.right.size > _SERIAL_POINTS or len(self._isolated[k].place)
        ]
        self._apart = apart[-1] + 1 if apart else 0

    def _cycle(
        self, k: int, source: FloatArray, response: FloatArray, add: bool, bands: Bands
    ) -> None:
        """One W-cycle from level `k` down, `source` of that level."""
        level, isolated = self.levels[k], self._isolated[k]
        if k >= self._apart:
            first = self._start[k]
            _cycle(
                (self._sizes[k:], self._start[k:]),
                Level(*self._coefficients[:, first:]),
                self._inverse,
                (self._value[first:], self._source[first:]),
                source,
                response,
                add,
            )
            return
        below = self.levels[k + 1]
        value, residual = self._vectors(k + 1)
        bands.run(below.size, smooth_and_restrict, level, source, residual)
        isolated.restrict(source, residual)
        self._cycle(k + 1, residual, value, False, bands)
        bands.run(below.size, subtract_product, below, value, residual)
        self._cycle(k + 1, residual, value, True, bands)
        bands.run(level.size, correct_and_smooth, level, source, value, add, response)
        isolated.correct(value, response)


@compiled
def _convert(values: FloatArray, factor: float, out: FloatArray, first: int, last: int) -> None:
    """Rows of `values` times `factor` into the padded single-precision `out`."""
    for i in range(first, min(last, values.shape[0])):
        for j in range(values.shape[1]):
            out[i + 1, j + 1] = values[i, j] * factor


@compiled
def _coarsen(fine: Level, coarse: Level, first: int, last: int) -> None:
    """Rows `first` … `last` − 1 of a coarser level: edges summed and halved, constraints summed."""
    right, down, ground = fine
    coarse_right, coarse_down, coarse_ground = coarse
    columns = coarse_right.shape[1] - 2
    half = np.float32(0.5)
    for i in range(first + 1, last + 1):
        a, b = 2 * i - 1, min(2 * i, right.shape[0] - 1)
        for j in range(1, columns + 1):
            c, d = 2 * j - 1, min(2 * j, right.shape[1] - 1)
            coarse_right[i, j] = half * (right[a, d] + right[b, d])
            coarse_down[i, j] = half * (down[b, c] + down[b, d])
            coarse_ground[i, j] = (ground[a, c] + ground[a, d]) + (ground[b, c] + ground[b, d])


@compiled
def _invert(level: Level) -> FloatArray:
    """Return the inverse (n, n) of a small level, by sweeping its points.

    A point without weight left when all before it are swept (a floating part ends with one) is
    constrained, so that the inverse exists.
    """
    right, down, ground = level
    rows, columns = right.shape[0] - 2, right.shape[1] - 2
    points = rows * columns
    matrix = np.zeros((points, points))
    for i in range(rows):
        for j in range(columns):
            here = i * columns + j
            matrix[here, here] += ground[i + 1, j + 1]
            for there, weight in (
                (here + 1, right[i + 1, j + 1]),
                (here + columns, down[i + 1, j + 1]),
            ):
                if weight > 0:
                    matrix[here, here] += weight
                    matrix[there, there] += weight
                    matrix[here, there] -= weight
                    matrix[there, here] -= weight
    least = _FREE * np.diag(matrix)
    for k in range(points):
        pivot = matrix[k, k]
        if pivot <= least[k]:
            matrix[k, :] = 0.0
            matrix[:, k] = 0.0
            continue
        row = matrix[k] / pivot
        for i in range(points):
            share = matrix[i, k]
            if i != k and share != 0:
                for j in range(points):
                    matrix[i, j] -= share * row[j]
        matrix[:, k] = row
        matrix[k] = row
        matrix[k, k] = -1.0 / pivot
    return (-matrix).astype(right.dtype)


@compiled
def _solve_coarsest(
    inverse: FloatArray, source: FloatArray, response: FloatArray, add: bool
) -> None:
    rows, columns = source.shape[0] - 2, source.shape[1] - 2
    flat = np.zeros(rows * columns, dtype=source.dtype)
    for i in range(rows):
        for j in range(columns):
            pull = source[i + 1, j + 1]
            row = inverse[i * columns + j]
            for k in range(len(flat)):
                flat[k] += pull * row[k]
    for i in range(rows):
        for j in range(columns):
            if add:
                response[i + 1, j + 1] += flat[i * columns + j]
            else:
                response[i + 1, j + 1] = flat[i * columns + j]


@compiled
def _grid(flat: FloatArray, layout: tuple[IntArray, IntArray], level: int) -> FloatArray:
    """Return one level (padded) of a flat array of several; `layout` is their sizes and starts."""
    sizes, start = layout
    span = slice(start[level] - start[0], start[level + 1] - start[0])
    return flat[span].reshape((sizes[level, 0] + 2, sizes[level, 1] + 2))


@compiled
def _level(flat: Level, layout: tuple[IntArray, IntArray], level: int) -> Level:
    """Return the coefficients of one level of several."""
    right, down = _grid(flat[0], layout, level), _grid(flat[1], layout, level)
    return Level(right, down, _grid(flat[2], layout, level))


@compiled
def _cycle(
    layout: tuple[IntArray, IntArray],
    coefficients: Level,
    inverse: FloatArray,
    vectors: tuple[FloatArray, FloatArray],
    source: FloatArray,
    response: FloatArray,
    add: bool,
) -> None:
    """One W-cycle over several levels in one call; the first has `source` and `response`.

    `vectors` are values and sources of the others. Not recursive, because Numba loads such a
    function from its cache in a state that crashes.
    """
    sizes, (values, sources) = layout[0], vectors
    last = len(sizes) - 1
    second = np.zeros(len(sizes), dtype=np.bool_)
    second[0] = add
    level = 0
    while True:
        while level < last:
            b = source if level == 0 else _grid(sources, layout, level)
            below = _grid(sources, layout, level + 1)
            here = _level(coefficients, layout, level)
            smooth_and_restrict(here, b, below, 0, sizes[level + 1, 0])
            level += 1
            second[level] = False
        b = source if last == 0 else _grid(sources, layout, last)
        x = response if last == 0 else _grid(values, layout, last)
        _solve_coarsest(inverse, b, x, second[last])
        second[last] = True  # it was exact
        while level > 0 and second[level]:
            level -= 1
            b = source if level == 0 else _grid(sources, layout, level)
            x = response if level == 0 else _grid(values, layout, level)
            below = _grid(values, layout, level + 1)
            here = _level(coefficients, layout, level)
            correct_and_smooth(here, b, below, second[level], x, 0, sizes[level, 0])
        if level == 0:
            return
        here = _level(coefficients, layout, level)
        value, rest = _grid(values, layout, level), _grid(sources, layout, level)
        subtract_product(here, value, rest, 0, sizes[level, 0])
        second[level] = True
