"""Conjugate gradients for energy (A), stopped by an estimate of the error of the heights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import eigh_tridiagonal

from spcola.arrays import BoolArray, FloatArray, read_only
from spcola.compilation import Bands, compiled
from spcola.heights import vectors
from spcola.heights.components import Components
from spcola.heights.graph import GraphCycle
from spcola.heights.means import add_mean_products, add_mean_pulls
from spcola.heights.multigrid import Hierarchy
from spcola.heights.problem import HeightProblem
from spcola.heights.smoothing import multiply

_SAFETY = 3.0
"""Ratio of the stated bound to the error in the preconditioned residual."""
_TRIAL = 5
"""Iterations in which the error must fall tenfold each time; else the weights are too irregular
for 2 × 2 aggregates. By experiment it falls either a hundredfold or by a third."""
_PATIENCE = 40
"""The same for stiff means: aggregates then join all points of each mean, which costs more."""
_CONSTRAINED = 0.2
"""Weight of a part, relative to the rim of a square of its size, above which the cycle alone
constrains it: by experiment, iterations grow below a tenth."""
_SPAN = 1e-4
"""Smallest weight relative to the largest down to which single precision is used."""
_REFRESH = 1e-3
"""Fall of the error after which the residual is recomputed in double precision: the rounding of
single precision (seven digits) must remain far below the error left."""

_FALLING = 0.5
"""Change of rᵀ z, on recomputing the residual, above which the search direction is reset."""


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Result of conjugate gradients; `height` (R, C) in metres, arbitrary outside the mask."""

    height: FloatArray
    iterations: int
    converged: bool
    error_bound_m: float


class LinearSystem:
    """The normal equations of a height problem for one set of constraint weights.

    Set up once, it solves for any steps and heights. Not to be shared between threads.

    Parameters
    ----------
    problem : HeightProblem
        Its mask and weights; steps and heights may be others in :meth:`solve`.
    weight : (R, C) ndarray
        Constraint weights, 1/m² (those of the problem, or scaled down by a robust loss).
    components : Components
        The parts of the problem.
    bands : Bands
        The threads to use.
    """

    def __init__(
        self, problem: HeightProblem, weight: FloatArray, components: Components, bands: Bands
    ) -> None:
        self._problem, self._weight, self._components = problem, weight, components
        ground = components.stiffness(problem, weight)
        # Means enter the cycle through an upper bound: weights of their single points.
        lumped = weight
        if problem.means is not None:
            lumped = weight + problem.means.lumped(problem.shape)
        smallest, largest = _extremes(problem, lumped, bands)
        # The power of two next to the largest weight: it makes all others at most 1.
        self._unit = float(2.0 ** np.ceil(np.log2(largest))) if largest > 0 else 1.0
        self._compliance = self._compliances(ground)
        self._parts = (components.labels, vectors.find_spans(components.labels, self.loose))
        kind = np.float32 if self._is_tame(ground, smallest) else np.float64
        self._hierarchy = Hierarchy(problem, lumped, self._unit, kind, bands)
        shape = (problem.shape[0] + 2, problem.shape[1] + 2)
        self._r, self._p, self._z = (np.zeros(shape, dtype=kind) for _ in range(3))
        self._graph: GraphCycle | None = None
        self._image = self._z
        self._spectrum = Spectrum()

    @property
    def precision(self) -> np.dtype[Any]:
        """Precision of vectors for :meth:`precondition`: single, unless weights span too much."""
        return self._r.dtype

    @property
    def loose(self) -> BoolArray:
        """Parts (K,) that are shifted as a whole: residuals must sum to zero over each."""
        return self._compliance > 0

    def _compliances(self, ground: FloatArray) -> FloatArray:
        """One over the stiffness of shifting a whole part (K,); 0 for parts that need no shift.

        The cycle represents the constant of a single part exactly. Its aggregates run across the
        gaps between several parts, which stiffens a part by up to its rim. Parts with far weaker
        constraints are shifted as a whole, after the cycle and by its residual (adding both would
        count the shift twice, for a quarter more iterations).
        """
        loose = ground < _CONSTRAINED * self._unit * np.sqrt(self._components.size)
        chosen = loose & (ground > 0) & (len(ground) > 1)
        return np.divide(self._unit, ground, out=np.zeros(len(ground)), where=chosen)

    def _is_tame(self, ground: FloatArray, smallest: float) -> bool:
        """Whether single precision is enough for the iteration: by experiment.

        It stalls where weights span 1e5 or a part of some 10⁴ points has a weight of only 1e-6.
        """
        least = _SPAN * self._unit
        constrained = ground > 0
        weak = ground[constrained] < least * np.sqrt(self._components.size[constrained])
        return smallest >= least and not weak.any()

    def residual(self, problem: HeightProblem, x: FloatArray, bands: Bands) -> FloatArray:
        """Return ``Dᵀ w_e (step − D x) + w_c (h_c − x)`` over the unit, padded (scratch memory)."""
        edges = (problem.step_x, problem.step_y, problem.weight_x, problem.weight_y)
        pulls = np.zeros((0, 0))
        if problem.means is not None:
            m = problem.means
            pulls = np.zeros(x.shape)
            add_mean_pulls(m.sets, m.height, m.weight, x, pulls)
        # One type of every layer, given or computed: one compiled form.
        weight, x = read_only(self._weight), read_only(x)
        arrays = (edges, (problem.height, weight), pulls, x, self._unit, self._r)
        bands.run(x.shape, vectors.residual, *arrays)
        return self._r

    def precondition(self, residual: FloatArray, bands: Bands) -> FloatArray:
        """Return the preconditioner's estimate of the error behind `residual` (scratch memory).

        It is symmetric for residuals that sum to zero over each loose part.
        """
        if self._graph is not None:
            self._graph.apply(residual, self._unit, self._z)
            return self._z
        self._hierarchy.apply(residual, self._z, bands)
        if self.loose.any():
            self._shift_parts(residual, bands)
        return self._z

    def _shift_parts(self, residual: FloatArray, bands: Bands) -> None:
        """Shift the response on each loose part so that ``residual − A z`` sums to zero over it."""
        shift = self._shifts(residual, bands).astype(self._z.dtype)
        bands.run(self._problem.shape, vectors.shift_parts, self._parts, shift, self._z)

    def _balance(self, x: FloatArray, residual: FloatArray, bands: Bands) -> None:
        """Shift `x` on the loose parts so that its `residual` sums to zero over each.

        All later residuals then do so too, and for these the preconditioner is symmetric.
        """
        self._z[...] = 0.0
        shift, ground = self._shifts(residual, bands), self._hierarchy.finest.ground
        bands.run(x.shape, vectors.balance_parts, self._parts, shift, ground, x, residual)

    def _shifts(self, residual: FloatArray, bands: Bands) -> FloatArray:
        """Return the shift (K,) of each loose part for which ``residual − A z`` sums to zero.

        The edges of a part act with equal and opposite forces, so that only its `ground` counts
        (that of means too: lumped, it acts like them on a part that moves as a whole).
        """
        arrays = (self._parts, len(self._compliance), residual, self._hierarchy.finest.ground)
        shares = bands.run(self._problem.shape, vectors.sum_parts, *arrays, self._z)
        return self._compliance * np.sum(shares, axis=0)

    def solve(
        self,
        problem: HeightProblem,
        start: FloatArray,
        tolerance_m: float,
        max_iterations: int,
        bands: Bands,
    ) -> LinearSolution:
        """Solve from `start` (R, C) until the error is estimated below `tolerance_m`.

        The error is estimated as the largest element of the preconditioned residual over the
        smallest eigenvalue of the preconditioned matrix, read from the coefficients of the
        iteration (Lanczos), times a safety factor. A small residual alone is no evidence: smooth
        errors hardly show in it. The residual of the last estimate is not the one updated by the
        iteration, but is computed from the heights in double precision.

        `start` is overwritten by the solution.
        """
        iterations, bound = self._iterate(problem, start, tolerance_m, max_iterations, bands)
        if bound > tolerance_m and self._graph is None and iterations < max_iterations:
            self._follow_edges()
            limit = max_iterations - iterations
            more, bound = self._iterate(problem, start, tolerance_m, limit, bands)
            iterations += more
        return LinearSolution(start, iterations, bound <= tolerance_m, bound)

    def _follow_edges(self) -> None:
        """Switch to aggregates that follow the strong edges."""
        self._graph = GraphCycle(self._problem, self._weight, self._components)
        self._spectrum = Spectrum()
        # Flexible directions need A p in addition to the new response.
        self._image = np.zeros_like(self._z)

    def _iterate(
        self, problem: HeightProblem, x: FloatArray, tolerance_m: float, limit: int, bands: Bands
    ) -> tuple[int, float]:
        """Improve `x` in place; return the iterations spent and the bound reached, metres."""
        spectrum, p, shape = self._spectrum, self._p, x.shape
        spectrum.restart()
        r = self.residual(problem, x, bands)
        if self.loose.any() and self._graph is None:
            self._balance(x, r, bands)
        z = self.precondition(r, bands)
        rz, largest = self._measure(r, z, bands)
        bound = spectrum.bound(largest)
        if bound == 0.0 or (spectrum.known and bound <= tolerance_m):
            return 0, bound
        bands.run(shape, vectors.copy, p, z)
        first = refreshed = largest
        due = False
        for done in range(1, limit + 1):
            q = self._image
            curvature = self._multiply(p, q, bands)
            if not (curvature > 0 and rz > 0):
                return done, bound
            alpha = rz / curvature
            bands.run(shape, vectors.step, x, r, p, q, alpha)
            fresh = due or done == limit or largest < _REFRESH * refreshed
            if fresh:
                self.residual(problem, x, bands)
            z = self.precondition(r, bands)
            before, (rz_new, largest_new) = largest, self._measure(r, z, bands)
            beta = (
                rz_new / rz if self._graph is None else -self._measure(z, q, bands)[0] / curvature
            )
            rz, largest = rz_new, largest_new
            if fresh:
                refreshed = largest
                # The updated residual may have been only rounding: directions conjugate to it lead
                # away from the solution, faster with every step.
                beta = beta if beta < _FALLING else 0.0
            spectrum.add(alpha, beta)
            bound = spectrum.bound(largest, enough=4 * tolerance_m)
            if bound <= tolerance_m and fresh:
                return done, bound
            if self._is_stuck(done, largest / first):
                return done, bound
            due = bound * min(largest / before, 1.0) <= tolerance_m
            bands.run(shape, vectors.turn, p, z, beta)
        return limit, bound

    def _multiply(self, p: FloatArray, out: FloatArray, bands: Bands) -> float:
        """Store ``A p`` in `out`; return ``pᵀ A p``."""
        level = self._hierarchy.finest
        total = float(sum(bands.run(level.size, multiply, level, p, out)))
        if self._problem.means is not None:
            m = self._problem.means
            total += add_mean_products(m.sets, m.weight, self._unit, p, out)
        return total

    def _is_stuck(self, done: int, share: float) -> bool:
        """Whether the error falls too slowly for this cycle."""
        patience = _TRIAL if self._problem.means is None else _PATIENCE
        judged = self._graph is None and done >= patience and done % _TRIAL == 0
        return judged and share > 0.1 ** (done // _TRIAL)

    def _measure(self, r: FloatArray, z: FloatArray, bands: Bands) -> tuple[float, float]:
        """Return ``rᵀ z`` and the largest ``|z|``, metres."""
        shares = bands.run(self._problem.shape, vectors.product_and_largest, r, z)
        product = sum(share[0] for share in shares)
        # max drops NaN: a failure must not look like an error of zero.
        largest = float(max(share[1] for share in shares)) if np.isfinite(product) else np.inf
        return product, largest


def _extremes(problem: HeightProblem, weight: FloatArray, bands: Bands) -> tuple[float, float]:
    """Return the smallest positive weight of an edge and the largest weight of all."""
    x, y, points = (
        bands.run(problem.shape, _band_extremes, each)
        for each in (problem.weight_x, problem.weight_y, weight)
    )
    smallest = min(share[0] for share in x + y)
    return float(smallest), float(max(share[1] for share in x + y + points))


@compiled
def _band_extremes(values: FloatArray, first: int, last: int) -> tuple[float, float]:
    """Return the smallest positive value and the largest, at least 0, of some rows."""
    columns = values.shape[1]
    smallest, largest = np.full(columns, np.inf), np.zeros(columns)
    for r in range(first, min(last, values.shape[0])):
        row = values[r]
        for c in range(columns):
            smallest[c] = min(smallest[c], row[c] if row[c] > 0 else np.inf)
        for c in range(columns):
            largest[c] = max(largest[c], row[c])
    if columns == 0:
        return np.inf, 0.0
    return smallest.min(), largest.max()


@dataclass
class Spectrum:
    """Smallest eigenvalue of the preconditioned matrix, from the coefficients of the iteration."""

    smallest: float = 1.0
    known: bool = False
    _diagonal: list[float] = field(default_factory=list)
    _side: list[float] = field(default_factory=list)
    _carry: float = 0.0

    def restart(self) -> None:
        """Forget the coefficients (a new Krylov space begins), not the eigenvalue."""
        self._diagonal, self._side, self._carry = [], [], 0.0

    def add(self, alpha: float, beta: float) -> None:
        """Append the coefficients of one iteration: a row of the Lanczos matrix."""
        self._diagonal.append(1.0 / alpha + self._carry)
        self._side.append(np.sqrt(max(beta, 0.0)) / alpha)
        self._carry = beta / alpha

    def bound(self, largest: float, enough: float = np.inf) -> float:
        """Return the bound on the error (metres) behind a preconditioned residual.

        `largest` is its largest element. The eigenvalue is updated only when the bound could fall
        below `enough`.
        """
        raw = _SAFETY * largest
        if self._diagonal and raw <= enough:
            lowest = eigh_tridiagonal(
                self._diagonal, self._side[:-1], eigvals_only=True, select="i", select_range=(0, 0)
            )
            self.smallest = min(self.smallest, max(float(lowest[0]), np.finfo(float).tiny))
            self.known = True
        return raw / self.smallest
