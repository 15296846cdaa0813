"""Linear estimation with correlated errors whose size is part of the question.

Displacements of mapolas and range residuals of images have errors of three kinds: what the
single match knows of itself (a covariance), what it cannot know (the error of a maplet's centre,
say: independent, of one unknown size), and what many share (the trajectory error of a scan, the
bias of a day: random effects of another unknown size). Leaving out the third makes every sigma
too small, because a hundred mapolas of one scan are then a hundred witnesses instead of one.

The model is ``y_i = A_i p + Z_i u + e_i`` with ``e_i ~ N(0, C_i + σ_m² I)``, ``u ~ N(0, σ_g² I)``
and Gaussian priors on ``p``. The two sizes σ_m, σ_g maximise the restricted likelihood (REML:
Patterson & Thompson 1971), which does not mistake the freedom of ``p`` for small errors. Robust
weights (Huber) and a final rejection keep single bad matches from pulling.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from spcola.arrays import BoolArray, FloatArray, check_finite, check_shape
from spcola.errors import InvalidValueError, NotObservableError
from spcola.robust import huber_weight

# Smallest share of the largest eigenvalue of the scaled normal matrix that is still information
# and not rounding.
_RANK_TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Observations:
    """N observations of D components each, linear in P parameters and R random effects.

    Parameters
    ----------
    value : (N, D) ndarray
        Observed minus computed.
    design : (N, D, P) ndarray
        Partial derivatives with respect to the parameters.
    covariance : (N, D, D) ndarray
        What each observation knows of its own error.
    effects : (N, D, R) ndarray
        How the random effects enter; R may be 0.

    Raises
    ------
    InvalidValueError
        If shapes disagree or a number is not finite.
    """

    value: FloatArray
    design: FloatArray
    covariance: FloatArray
    effects: FloatArray

    def __post_init__(self) -> None:
        count, size = self.value.shape
        check_shape(self.design, (count, size, None), "design")
        check_shape(self.covariance, (count, size, size), "covariance")
        check_shape(self.effects, (count, size, None), "effects")
        for name in ("value", "design", "covariance", "effects"):
            check_finite(getattr(self, name), name)

    def select(self, keep: BoolArray) -> Observations:
        """Return the observations chosen by the mask `keep` (N,)."""
        return Observations(
            self.value[keep], self.design[keep], self.covariance[keep], self.effects[keep]
        )


@dataclass(frozen=True)
class ErrorSizes:
    """Sizes of the errors that single observations cannot know, in the unit of the values.

    As a prior, each is the median of a log-normal distribution that is `width` wide (standard
    deviation of the natural logarithm); a size of 0 is held at 0, and a width of 0 holds both.
    """

    independent: float
    shared: float
    width: float = 1.0


@dataclass(frozen=True, eq=False)
class MixedFit:
    """What came out.

    Attributes
    ----------
    estimate : (P,) ndarray
    covariance : (P, P) ndarray
    residual : (N, D) ndarray
        Observed minus computed, shared effects **not** removed.
    conditional : (N, D) ndarray
        The same with the estimated shared effects removed.
    effects : (R,) ndarray
        Estimated random effects.
    weight : (N,) ndarray
        Final robust weights; 0 where rejected.
    sizes : ErrorSizes
        Estimated error sizes.
    iterations : int
    converged : bool
    reason : str
        Why it stopped.
    """

    estimate: FloatArray
    covariance: FloatArray
    residual: FloatArray
    conditional: FloatArray
    effects: FloatArray
    weight: FloatArray
    sizes: ErrorSizes
    iterations: int
    converged: bool
    reason: str

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations (P,) of the estimate."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def used(self) -> BoolArray:
        """Mask (N,) of observations that were not rejected."""
        mask: BoolArray = self.weight > 0
        return mask


@dataclass(frozen=True, eq=False)
class MixedOptions:
    """How the fit is done.

    Parameters
    ----------
    prior : (P,) ndarray
        Standard deviation of the Gaussian prior (about 0) of each parameter; inf for none.
    sizes : ErrorSizes
        Prior of the error sizes.
    scale : (P,) ndarray
        A natural size of each parameter, by which the normal matrix is made dimensionless
        before its rank is judged.
    names : tuple of str
        Names of the parameters, for messages.
    reject : float
        Observations further off than this many standard deviations do not enter.
    max_rounds : int
        Most re-weightings, before and after rejection begins.
    robust : bool
        False: plain weighted least squares, nothing rejected.
    """

    prior: FloatArray
    sizes: ErrorSizes
    scale: FloatArray
    names: tuple[str, ...]
    reject: float = 5.0
    max_rounds: int = 20
    robust: bool = True


def fit_mixed(observations: Observations, options: MixedOptions) -> MixedFit:
    """Estimate parameters, error sizes and shared effects together.

    Raises
    ------
    NotObservableError
        If the observations and priors leave a combination of parameters free; the parameters
        in it are named. Or if half of the observations contradict the rest.
    InvalidValueError
        If there is no observation.
    """
    count = len(observations.value)
    if count == 0:
        raise InvalidValueError("there is no observation", "fit")
    check_rank(_reach(observations, options), options.names)
    state = _State(np.ones(count), options.sizes)
    # Nothing is rejected before the weights have settled: a fit that outliers still pull would
    # reject the good ones.
    for reject in (np.inf, options.reject):
        for _ in range(options.max_rounds):
            state = _round(observations, options, state, reject)
            if state.settled:
                break
        if not options.robust:
            break
    solution = _solve(
        observations.select(state.used), state.before[state.used], options, state.sizes
    )
    residual, conditional = _residuals(observations, solution)
    return MixedFit(
        estimate=solution.estimate,
        covariance=solution.covariance,
        residual=residual,
        conditional=conditional,
        effects=solution.effects,
        weight=state.before,
        sizes=state.sizes,
        iterations=state.rounds,
        converged=state.settled,
        reason="weights settled"
        if state.settled
        else f"weights still moved after {state.rounds} rounds",
    )


@dataclass(frozen=True, eq=False)
class _State:
    """Where the re-weighting stands: weights after and before the last round."""

    weight: FloatArray
    sizes: ErrorSizes
    before: FloatArray = field(default_factory=lambda: np.ones(0))
    rounds: int = 0
    settled: bool = False

    @property
    def used(self) -> BoolArray:
        """Observations that entered the last round."""
        mask: BoolArray = self.before > 0
        return mask


def _round(
    observations: Observations, options: MixedOptions, state: _State, reject: float
) -> _State:
    """One round: error sizes, solution, new weights."""
    used = state.weight > 0
    chosen, weight = observations.select(used), state.weight[used]
    sizes = _estimate_sizes(chosen, weight, options, state.sizes)
    solution = _solve(chosen, weight, options, sizes)
    _, conditional = _residuals(observations, solution)
    new = (
        _robust_weights(conditional, observations, sizes, reject)
        if options.robust
        else (state.weight)
    )
    same_rejected = np.array_equal(new > 0, used)
    if np.count_nonzero(new) <= len(new) / 2:
        raise NotObservableError(
            f"the observations contradict one another: {np.count_nonzero(new)} of {len(new)} agree "
            f"within {reject:g} sigma",
            options.names,
            do="look at the single matches: they may be of another body or another epoch",
        )
    settled = same_rejected and bool(np.max(np.abs(new - state.weight)) < 1e-3)
    return _State(new, sizes, state.weight, state.rounds + 1, settled)


def _residuals(observations: Observations, solution: _Solution) -> tuple[FloatArray, FloatArray]:
    """Residuals (N, D) with the shared effects in them, and without."""
    residual = observations.value - np.einsum("ndp,p->nd", observations.design, solution.estimate)
    return residual, residual - np.einsum("ndr,r->nd", observations.effects, solution.effects)


def _reach(observations: Observations, options: MixedOptions) -> FloatArray:
    """Scaled normal matrix (P, P) of the design alone: what could be seen with perfect data.

    A parameter with a prior is never free.
    """
    rows = (observations.design * options.scale).reshape(-1, len(options.scale))
    return rows.T @ rows / len(rows) + np.diag(np.isfinite(options.prior).astype(np.float64))


@dataclass(frozen=True, eq=False)
class _Solution:
    estimate: FloatArray
    effects: FloatArray
    covariance: FloatArray
    deviance: float


def _solve(
    observations: Observations, weight: FloatArray, options: MixedOptions, sizes: ErrorSizes
) -> _Solution:
    """Solve for parameters and shared effects at given error sizes.

    The shared effects are carried as parameters with a prior of 1/σ_g², which is Henderson's
    form of the same estimator: no N × N covariance is ever built.
    """
    value, size = observations.value, observations.value.shape[1]
    spread = (observations.covariance + sizes.independent**2 * np.eye(size)) / weight[:, None, None]
    with_effects = sizes.shared > 0 and observations.effects.shape[2] > 0
    parts = [observations.design, observations.effects] if with_effects else [observations.design]
    design = np.concatenate(parts, axis=2)
    whitener = np.linalg.inv(np.linalg.cholesky(spread))
    rows = np.einsum("nij,njp->nip", whitener, design).reshape(-1, design.shape[2])
    seen = np.einsum("nij,nj->ni", whitener, value).ravel()
    parameters = observations.design.shape[2]
    effects = design.shape[2] - parameters
    precision = np.concatenate(
        [1.0 / options.prior**2, np.full(effects, 1.0 / sizes.shared**2 if effects else 0.0)]
    )
    normal = rows.T @ rows + np.diag(precision)
    # Unit diagonal: metres, radians and scales differ by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.diag(normal))
    unitless = normal * np.outer(scale, scale)
    lower = np.linalg.cholesky(unitless)
    right = rows.T @ seen
    inverse = np.linalg.inv(unitless) * np.outer(scale, scale)
    both = inverse @ right
    covariance = inverse[:parameters, :parameters]
    deviance = (
        float(seen @ seen - both @ right)
        - 2.0 * float(np.sum(np.log(np.einsum("nii->ni", whitener))))
        + 2.0 * float(np.sum(np.log(np.diag(lower) / scale)))
        + 2.0 * effects * float(np.log(sizes.shared) if effects else 0.0)
    )
    full = np.zeros(observations.effects.shape[2])
    if effects:
        full[:] = both[parameters:]
    return _Solution(both[:parameters], full, covariance, deviance)


def check_rank(information: FloatArray, names: tuple[str, ...]) -> None:
    """Refuse a scaled information matrix (P, P) that leaves some direction free.

    Raises
    ------
    NotObservableError
        Naming the parameters that take part in the free directions.
    """
    values, vectors = np.linalg.eigh(information)
    free = values <= _RANK_TOLERANCE * max(float(values[-1]), 0.0)
    if not free.any():
        return
    taking_part = np.max(np.abs(vectors[:, free]), axis=1) > 0.1
    involved = tuple(name for name, part in zip(names, taking_part, strict=True) if part)
    raise NotObservableError(
        f"the observations leave {', '.join(involved)} free",
        involved,
        do="add observations from other parts of the body, or estimate fewer parameters",
    )


def _estimate_sizes(
    observations: Observations, weight: FloatArray, options: MixedOptions, start: ErrorSizes
) -> ErrorSizes:
    """Maximise the restricted likelihood over the error sizes that are not held at 0."""
    prior = options.sizes
    names = [
        name
        for name in ("independent", "shared")
        if getattr(prior, name) > 0
        and prior.width > 0
        and (name == "independent" or observations.effects.shape[2])
    ]
    if not names:
        return start
    center = np.log([getattr(prior, name) for name in names])

    def cost(logs: FloatArray) -> float:
        sizes = _sized(start, names, logs, center)
        solution = _solve(observations, weight, options, sizes)
        return solution.deviance + float(np.sum((logs - center) ** 2)) / prior.width**2

    begin = np.log([max(getattr(start, name), 1e-12) for name in names])
    simplex = np.vstack([begin, begin + 0.4 * np.eye(len(names))])
    found = minimize(
        cost,
        begin,
        method="Nelder-Mead",
        options={"xatol": 1e-2, "fatol": 1e-3, "maxiter": 200, "initial_simplex": simplex},
    )
    return _sized(start, names, found.x, center)


def _sized(sizes: ErrorSizes, names: list[str], logs: FloatArray, center: FloatArray) -> ErrorSizes:
    """`sizes` with those in `names` set; e⁻¹⁰ of what was expected is as good as none."""
    values = np.exp(np.clip(logs, center - 10.0, center + 10.0))
    return replace(sizes, **dict(zip(names, values.tolist(), strict=True)))


def _robust_weights(
    conditional: FloatArray, observations: Observations, sizes: ErrorSizes, reject: float
) -> FloatArray:
    """Huber weights (N,) by the size of each residual in its own standard deviations."""
    size = conditional.shape[1]
    spread = observations.covariance + sizes.independent**2 * np.eye(size)
    solved = np.linalg.solve(spread, conditional[..., None])[..., 0]
    distance = np.sqrt(np.einsum("ni,ni->n", conditional, solved) / size)
    weights: FloatArray = huber_weight(distance, k=2.0)
    weights[distance > reject] = 0.0
    return weights
