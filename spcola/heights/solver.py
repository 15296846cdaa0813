"""Surface from slopes and sparse heights: the minimiser of energy (A)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray, check_shape, read_only
from spcola.compilation import Bands, compiled, is_kept
from spcola.errors import InvalidValueError, SettingsError
from spcola.heights.components import Components, find_components
from spcola.heights.conjugate import LinearSolution, LinearSystem
from spcola.heights.problem import HeightProblem
from spcola.heights.smoothing import multiply
from spcola.math.robust import cauchy_weight, huber_weight

Loss = Literal["l2", "huber", "cauchy"]
Floating = Literal["start", "zero_mean", "unknown"]


@dataclass(frozen=True)
class SolverOptions:
    """Settings of :func:`solve_heights`.

    Parameters
    ----------
    tolerance_m : float
        Estimated largest error of a height at which the solver stops, metres.
    max_iterations : int
        Iterations of conjugate gradients, for each linear solution.
    loss : {"l2", "huber", "cauchy"}
        Loss on the constraints of points; steps and means are always least squares.
    loss_scale : float
        Residual where the loss leaves the parabola, in sigmas of the constraint (σ = 1/√weight).
    max_reweights : int
        Linear solutions of a robust loss.
    floating : {"start", "zero_mean", "unknown"}
        Height of a part without any constraint: its mean over the points where `start` has a
        height (zero mean where it has none), zero mean, or NaN.
    threads : int, optional
        For grids of more than a million points; the number of cores (at most 8) if not given. The
        result does not depend on it.

    Raises
    ------
    SettingsError
        If a number is not positive or a name is unknown.
    """

    tolerance_m: float = 1e-6
    max_iterations: int = 500
    loss: Loss = "l2"
    loss_scale: float = 2.0
    max_reweights: int = 50
    floating: Floating = "start"
    threads: int | None = None

    def __post_init__(self) -> None:
        for name in ("tolerance_m", "max_iterations", "loss_scale", "max_reweights"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SettingsError(f"must be positive, not {value}", name)
        if self.threads is not None and self.threads < 1:
            raise SettingsError(f"must be at least 1, not {self.threads}", "threads")
        if self.loss not in ("l2", "huber", "cauchy"):
            raise SettingsError(f"is {self.loss!r}", "loss", "choose l2, huber or cauchy")
        if self.floating not in ("start", "zero_mean", "unknown"):
            raise SettingsError(
                f"is {self.floating!r}", "floating", "choose start, zero_mean or unknown"
            )


@dataclass(frozen=True, eq=False)
class HeightSolution:
    """The surface, with the solver's state and error bound.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres; NaN outside the mask, at single points that nothing determines, and on floating
        parts if requested.
    constraint_weight : (R, C) ndarray
        Weights of the constraints in the last linear solution, 1/m²: those of the problem times
        the factor of the robust loss.
    components : (R, C) integer ndarray
        Label of the part that each point belongs to; −1 outside the mask.
    floating : (F,) integer ndarray
        Labels of the parts without any constraint: their mean height is a convention.
    iterations : int
        Iterations of conjugate gradients, summed over the linear solutions.
    converged : bool
        Whether the tolerance was reached (by every linear solution and by the reweighting).
    reason : str
        Why the solver stopped.
    error_bound_m : float
        Estimated largest distance to the exact minimiser of the last linear problem, metres.
    """

    height: FloatArray
    constraint_weight: FloatArray
    components: IntArray
    floating: IntArray
    iterations: int
    converged: bool
    reason: str
    error_bound_m: float


def solve_heights(
    problem: HeightProblem,
    *,
    options: SolverOptions | None = None,
    start: FloatArray | None = None,
) -> HeightSolution:
    """Minimise energy (A) (the converged relaxation of Gaskell et al., eqs. 22 and 23).

    Parameters
    ----------
    problem : HeightProblem
        Steps, constraints, weights, mask.
    options : SolverOptions, optional
        Tolerance, robust loss, floating parts.
    start : (R, C) ndarray, optional
        First guess, metres; NaN where there is none. It also sets the mean of floating parts.

    Returns
    -------
    HeightSolution

    Raises
    ------
    InvalidValueError
        If `start` has another shape or an infinite height.
    """
    chosen = SolverOptions() if options is None else options
    return HeightSystem(problem, threads=chosen.threads).solve(problem, options=chosen, start=start)


class HeightSystem:
    """Height problems of one mask and one set of weights: set up once, solved many times.

    Parameters
    ----------
    problem : HeightProblem
        Only its mask and weights are used.
    threads : int, optional
        For grids of more than a million points; the number of cores (at most 8) if not given. The
        result does not depend on it.

    Notes
    -----
    Not to be shared between threads: it contains the solver's working memory.
    """

    def __init__(self, problem: HeightProblem, *, threads: int | None = None) -> None:
        self._problem = problem
        self._threads = threads
        with Bands(problem.mask.size, threads) as bands:
            self._parts = find_components(problem, bands)
        self._linear: LinearSystem | None = None

    @staticmethod
    def is_compiled() -> bool:
        """Return whether compiled forms of the solver's kernels are kept on this machine."""
        return is_kept(multiply)

    def solve(
        self,
        problem: HeightProblem,
        *,
        options: SolverOptions | None = None,
        start: FloatArray | None = None,
    ) -> HeightSolution:
        """Minimise energy (A) for `problem`, as :func:`solve_heights` does.

        Parameters
        ----------
        problem : HeightProblem
            That of the system, or one made of it by :meth:`HeightProblem.with_data`.
        options : SolverOptions, optional
            Tolerance, robust loss, floating parts.
        start : (R, C) ndarray, optional
            First guess, metres; NaN where there is none. It also sets the mean of floating parts.

        Raises
        ------
        InvalidValueError
            If `problem` has other weights, or `start` another shape or an infinite height.
        """
        chosen = SolverOptions() if options is None else options
        if not problem.has_weights_of(self._problem):
            raise InvalidValueError(
                "has other weights than the system", "problem", "make it by HeightProblem.with_data"
            )
        with Bands(problem.mask.size, self._threads) as bands:
            guess = _first_guess(problem, self._parts, start, bands)
            if self._linear is None:
                self._linear = LinearSystem(problem, problem.weight, self._parts, bands)
            linear = self._linear.solve(
                problem, guess, chosen.tolerance_m, chosen.max_iterations, bands
            )
            weight, iterations, converged = problem.weight, linear.iterations, True
            if chosen.loss != "l2":
                linear, weight, converged = _reweight(problem, self._parts, linear, chosen, bands)
                iterations += linear.iterations
            height = linear.height
            _set_floating(height, self._parts, start, chosen.floating)
            height[~problem.mask] = np.nan
        return HeightSolution(
            read_only(height),
            read_only(weight),
            read_only(self._parts.labels),
            read_only(self._parts.floating),
            iterations,
            linear.converged and converged,
            _reason(linear, converged, chosen),
            linear.error_bound_m,
        )


def _reweight(
    problem: HeightProblem,
    parts: Components,
    linear: LinearSolution,
    options: SolverOptions,
    bands: Bands,
) -> tuple[LinearSolution, FloatArray, bool]:
    """Reweight the constraints by their residuals until the surface no longer changes.

    Returns the last linear solution with the sum of the iterations, its weights, and whether
    the reweighting converged.
    """
    used = problem.weight > 0
    root = np.sqrt(problem.weight[used])
    loss_weight = huber_weight if options.loss == "huber" else cauchy_weight
    iterations, converged, weight = 0, False, problem.weight
    for _ in range(options.max_reweights):
        before = linear.height
        residual = (before[used] - problem.height[used]) * root
        factor = loss_weight(residual, options.loss_scale)
        weight = np.zeros(problem.shape)
        # No constraint gets weight 0, or its part could become floating.
        weight[used] = problem.weight[used] * np.maximum(factor, 1e-12)
        system = LinearSystem(problem, weight, parts, bands)
        linear = system.solve(
            problem, before.copy(), options.tolerance_m, options.max_iterations, bands
        )
        iterations += linear.iterations
        change = np.abs(linear.height - before)[problem.mask].max(initial=0.0)
        converged = bool(change <= 10 * options.tolerance_m)
        if converged:
            break
    return replace(linear, iterations=iterations), weight, converged


def _first_guess(
    problem: HeightProblem, parts: Components, start: FloatArray | None, bands: Bands
) -> FloatArray:
    """Fill gaps of `start` (or nothing) with the mean constraint of each part, in a new array."""
    used = problem.weight > 0
    pulls = problem.weight[used] * problem.height[used]
    # Without any constraint the counts are whole numbers.
    total = np.bincount(parts.labels[used], pulls, len(parts.size)).astype(np.float64)
    if problem.means is not None:
        means = problem.means
        owner = parts.labels.ravel()[means.points[means.start[:-1]]]
        total += np.bincount(owner, means.weight * means.height, len(total))
    mean = np.divide(total, parts.weight, out=np.zeros(len(total)), where=parts.weight > 0)
    guess = np.full(problem.shape, np.nan)
    if start is not None:
        check_shape(start, problem.shape, "start")
        if np.isinf(start).any():
            raise InvalidValueError("contains an infinite height", "start")
        guess[...] = start
    bands.run(problem.shape, _fill_gaps, parts.labels, mean, guess)
    return guess


@compiled
def _fill_gaps(labels: IntArray, mean: FloatArray, out: FloatArray, first: int, last: int) -> None:
    """Put NaN at the mean of its part, and 0 outside of all parts."""
    for r in range(first, last):
        for c in range(labels.shape[1]):
            if labels[r, c] < 0:
                out[r, c] = 0.0
            elif np.isnan(out[r, c]):
                out[r, c] = mean[labels[r, c]]


def _set_floating(
    tied: FloatArray, parts: Components, start: FloatArray | None, how: Floating
) -> None:
    """Give the floating parts of `tied` (R, C) the mean chosen by `how`."""
    if len(parts.floating) == 0:
        return
    loose = parts.is_floating
    if how == "unknown":
        tied[loose] = np.nan
        return
    labels, count = parts.labels, len(parts.size)
    aim = np.full(tied.shape, np.nan) if start is None or how == "zero_mean" else start
    known = loose & np.isfinite(aim)
    points = np.bincount(labels[known], minlength=count)
    gap = _sums(aim - tied, labels, known, count)
    shift = np.divide(gap, points, out=np.zeros(count), where=points > 0)
    zero_mean = -_sums(tied, labels, loose, count) / parts.size
    shift = np.where(points > 0, shift, zero_mean)
    tied[loose] += shift[labels[loose]]
    # A lone point without neighbours, constraint or start is unknown, not zero.
    tied[loose & ((parts.size == 1) & (points == 0))[labels]] = np.nan


def _sums(values: FloatArray, labels: IntArray, where: BoolArray, count: int) -> FloatArray:
    """Return the sum of `values` over each part's points in the mask `where`."""
    return np.bincount(labels[where], weights=values[where], minlength=count).astype(np.float64)


def _reason(linear: LinearSolution, converged: bool, options: SolverOptions) -> str:
    """Return in one clause why the solver stopped."""
    if not linear.converged:
        return (
            f"stopped after {linear.iterations} iterations with an estimated error of "
            f"{linear.error_bound_m:.2g} m, above the tolerance of {options.tolerance_m:.2g} m"
        )
    if not converged:
        return f"the {options.loss} weights still changed after {options.max_reweights} rounds"
    return f"estimated error {linear.error_bound_m:.2g} m, below the tolerance"
