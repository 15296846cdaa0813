"""Conjugate gradients for energy (A), stopped by an estimate of the error of the heights."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigh_tridiagonal

from spcola.arrays import FloatArray, IntArray
from spcola.heights.components import Components
from spcola.heights.direct import DirectSolver
from spcola.heights.multigrid import Hierarchy, Multigrid, build_hierarchy
from spcola.heights.problem import HeightProblem
from spcola.kernel import kernel

_SAFETY = 3.0
"""How much larger the stated bound is than the error that the preconditioner sees."""
_RESTARTS = 4
"""Passes with a freshly computed residual: the second one confirms the first."""
_PATIENCE = 80
"""Iterations after which the weights count as too wild for 2 × 2 aggregates."""
_DIRECT_LIMIT = 400_000
"""Points up to which sparse factors then take over (some GiB of memory)."""


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """What conjugate gradients reached; `height` (R, C) in metres, arbitrary outside the mask."""

    height: FloatArray
    iterations: int
    converged: bool
    error_bound_m: float


class LinearSystem:
    """The normal equations of a height problem for one set of constraint weights.

    Parameters
    ----------
    problem : HeightProblem
    weight : (R, C) ndarray
        Constraint weights, 1/m² (those of the problem, or scaled down by a robust loss).
    components : Components
        The parts of the problem.
    """

    def __init__(self, problem: HeightProblem, weight: FloatArray, components: Components) -> None:
        self._problem = problem
        self._weight = weight
        self._components = components
        self._labels = components.labels
        ground = np.bincount(
            components.labels[problem.mask],
            weights=weight[problem.mask],
            minlength=len(components.size),
        )
        # One over the stiffness of lifting a whole part. The cycle carries the constant of a
        # single part exactly, but its aggregates run across the gaps between several.
        self._lift = np.divide(1.0, ground, out=np.zeros(len(ground)), where=ground > 0)
        self._several = len(ground) > 1
        self._hierarchy: Hierarchy = build_hierarchy(problem, weight)
        self._multigrid = Multigrid(self._hierarchy)
        self._direct: DirectSolver | None = None

    def residual(self, height: FloatArray) -> FloatArray:
        """Return ``Dᵀ w_e (step − D h) + w_c (h_c − h)``, padded, for padded heights."""
        p = self._problem
        out = np.zeros_like(height)
        _residual(p.step_x, p.step_y, p.weight_x, p.weight_y, p.height, self._weight, height, out)
        return out

    def precondition(self, residual: FloatArray) -> FloatArray:
        """Return the preconditioner's guess at the error behind `residual` (scratch memory)."""
        if self._direct is not None:
            return self._direct.apply(residual)
        answer = self._multigrid.apply(residual)
        if self._several:
            _lift_components(self._labels, self._lift, residual, answer)
        return answer

    def times(self, vector: FloatArray, out: FloatArray) -> float:
        """Store ``A vector`` in `out` and return ``vectorᵀ A vector``."""
        levels = self._hierarchy
        e, s, g = (levels.finest(each) for each in (levels.right, levels.down, levels.ground))
        return float(_multiply(e, s, g, vector, out))

    def solve(self, start: FloatArray, tolerance_m: float, max_iterations: int) -> LinearSolution:
        """Solve from `start` (R, C) until the error is estimated below `tolerance_m`.

        The error is estimated as the largest element of the preconditioned residual over the
        smallest eigenvalue of the preconditioned matrix, read from the coefficients of the
        iteration (Lanczos), times a safety factor. A small residual alone says little: smooth
        errors hardly show in it.
        """
        x = np.zeros(self._hierarchy.padded_shape)
        x[1:-1, 1:-1] = start
        small = np.count_nonzero(self._problem.mask) <= _DIRECT_LIMIT
        patience = min(_PATIENCE, max_iterations) if small else max_iterations
        iterations, bound = self._pass(x, tolerance_m, patience)
        if bound > tolerance_m and patience < max_iterations:
            self._direct = DirectSolver(self._problem, self._weight, self._components)
            more, bound = self._pass(x, tolerance_m, max_iterations - iterations)
            iterations += more
        return LinearSolution(x[1:-1, 1:-1], iterations, bound <= tolerance_m, bound)

    def _pass(self, x: FloatArray, tolerance_m: float, limit: int) -> tuple[int, float]:
        """Improve `x` in place; return the iterations spent and the bound reached, metres."""
        spectrum = _Spectrum()
        iterations, bound = 0, np.inf
        for _ in range(_RESTARTS):
            fresh = self.residual(x)
            bound = spectrum.bound(self.precondition(fresh))
            done = bound <= tolerance_m and (iterations > 0 or bound == 0.0)
            if done or iterations >= limit:
                break
            iterations += self._iterate(x, fresh, spectrum, 0.5 * tolerance_m, limit - iterations)
        return iterations, float(bound)

    def _iterate(
        self, x: FloatArray, r: FloatArray, spectrum: _Spectrum, tolerance_m: float, limit: int
    ) -> int:
        """Improve `x` and its residual `r` in place; return the number of iterations."""
        spectrum.restart()
        z = self.precondition(r)
        p = z.copy()
        q = np.zeros_like(p)
        rz = _dot(r, z)
        for done in range(1, limit + 1):
            curvature = self.times(p, q)
            if not (curvature > 0 and rz > 0):
                return done
            alpha = rz / curvature
            _step(x, r, p, q, alpha)
            z = self.precondition(r)
            previous, rz = rz, _dot(r, z)
            beta = rz / previous
            spectrum.add(alpha, beta)
            if spectrum.bound(z, enough=tolerance_m) <= tolerance_m:
                return done
            _turn(p, z, beta)
        return limit


@dataclass
class _Spectrum:
    """Smallest eigenvalue of the preconditioned matrix, from the coefficients of the iteration."""

    smallest: float = 1.0
    _diagonal: list[float] = field(default_factory=list)
    _side: list[float] = field(default_factory=list)
    _carry: float = 0.0

    def restart(self) -> None:
        """Forget the coefficients (a new Krylov space begins), not what they told."""
        self._diagonal, self._side, self._carry = [], [], 0.0

    def add(self, alpha: float, beta: float) -> None:
        """Take in the coefficients of one iteration: a row of the Lanczos matrix."""
        self._diagonal.append(1.0 / alpha + self._carry)
        self._side.append(np.sqrt(max(beta, 0.0)) / alpha)
        self._carry = beta / alpha

    def bound(self, seen: FloatArray, enough: float = np.inf) -> float:
        """Return the bound on the error (metres) behind the preconditioned residual `seen`.

        The eigenvalue is looked up only when the bound could fall below `enough`.
        """
        raw = _SAFETY * float(_largest(seen))
        if self._diagonal and raw <= enough:
            lowest = eigh_tridiagonal(
                self._diagonal, self._side[:-1], eigvals_only=True, select="i", select_range=(0, 0)
            )
            self.smallest = min(self.smallest, max(float(lowest[0]), np.finfo(float).tiny))
        return raw / self.smallest


@kernel
def _residual(
    step_x: FloatArray,
    step_y: FloatArray,
    weight_x: FloatArray,
    weight_y: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    x: FloatArray,
    out: FloatArray,
) -> None:
    """Residual of the normal equations, summed from misfits: exact also far from zero height."""
    rows, columns = height.shape
    for r in range(rows):
        for c in range(columns):
            if weight[r, c] > 0:
                out[r + 1, c + 1] += weight[r, c] * (height[r, c] - x[r + 1, c + 1])
        for c in range(columns - 1):
            pull = weight_x[r, c] * (step_x[r, c] - (x[r + 1, c + 2] - x[r + 1, c + 1]))
            out[r + 1, c + 2] += pull
            out[r + 1, c + 1] -= pull
        if r + 1 < rows:
            for c in range(columns):
                pull = weight_y[r, c] * (step_y[r, c] - (x[r + 2, c + 1] - x[r + 1, c + 1]))
                out[r + 2, c + 1] += pull
                out[r + 1, c + 1] -= pull


@kernel
def _multiply(e: FloatArray, s: FloatArray, g: FloatArray, p: FloatArray, out: FloatArray) -> float:
    """Store ``A p`` in `out`, return ``pᵀ A p``."""
    total = 0.0
    for i in range(1, p.shape[0] - 1):
        for j in range(1, p.shape[1] - 1):
            here = p[i, j]
            value = (
                g[i, j] * here
                + e[i, j] * (here - p[i, j + 1])
                + e[i, j - 1] * (here - p[i, j - 1])
                + s[i, j] * (here - p[i + 1, j])
                + s[i - 1, j] * (here - p[i - 1, j])
            )
            out[i, j] = value
            total += here * value
    return total


@kernel
def _lift_components(
    labels: IntArray, lift: FloatArray, residual: FloatArray, answer: FloatArray
) -> None:
    """Add to `answer` the shift of each whole part that its summed residual asks for."""
    total = np.zeros(len(lift))
    rows, columns = labels.shape
    for r in range(rows):
        for c in range(columns):
            if labels[r, c] >= 0:
                total[labels[r, c]] += residual[r + 1, c + 1]
    for r in range(rows):
        for c in range(columns):
            if labels[r, c] >= 0:
                answer[r + 1, c + 1] += lift[labels[r, c]] * total[labels[r, c]]


@kernel
def _step(x: FloatArray, r: FloatArray, p: FloatArray, q: FloatArray, alpha: float) -> None:
    """``x += α p``, ``r −= α q`` in one pass."""
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            x[i, j] += alpha * p[i, j]
            r[i, j] -= alpha * q[i, j]


@kernel
def _turn(p: FloatArray, z: FloatArray, beta: float) -> None:
    """``p = z + β p``: the next direction."""
    for i in range(1, p.shape[0] - 1):
        for j in range(1, p.shape[1] - 1):
            p[i, j] = z[i, j] + beta * p[i, j]


@kernel
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(1, a.shape[0] - 1):
        for j in range(1, a.shape[1] - 1):
            total += a[i, j] * b[i, j]
    return total


@kernel
def _largest(a: FloatArray) -> float:
    largest = 0.0
    for i in range(1, a.shape[0] - 1):
        for j in range(1, a.shape[1] - 1):
            largest = max(largest, abs(a[i, j]))
    return largest
