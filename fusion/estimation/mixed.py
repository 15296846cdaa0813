"""Linear estimation with shared errors and variance components.

Displacements of mapolas and range residuals of images have three parts of error: the covariance
of the single match, an independent error of unknown size (such as that of a maplet's centre), and
errors that many observations share (the trajectory error of a scan, the bias of a day), which are
random effects of unknown size. Without the shared errors every sigma comes out too small, because
a hundred mapolas of one scan then count as a hundred independent observations.

The model is ``y_i = A_i p + Σ_g Z_ig u_g + e_i`` with ``e_i ~ N(0, C_i + σ_m² I)``,
``u_g ~ N(0, σ_g² I)`` and Gaussian priors on ``p``. The sizes σ_m, σ_g maximise the restricted
likelihood (REML: Patterson & Thompson 1971), which accounts for the degrees of freedom that ``p``
takes. Robust weights (Huber) and a final rejection limit the influence of single bad matches.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fusion.estimation.equations import MixedEquations, spread_of
from fusion.estimation.rank import check_rank
from fusion.estimation.values import ErrorSizes, MixedFit, MixedOptions, Observations
from fusion.runtime.machine import one_blas_thread
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.errors import InvalidValueError, NotObservableError
from spcola.math.robust import huber_weight
from spcola.math.statistics import SizeLikelihood, most_likely_sizes


def fit_mixed(observations: Observations, options: MixedOptions) -> MixedFit:
    """Estimate parameters, error sizes and shared effects together.

    At given sizes, Henderson's mixed-model equations are solved; the sizes maximise the restricted
    likelihood (Patterson & Thompson 1971). Docs: derivations §12.

    Parameters
    ----------
    observations : Observations
        In one unit throughout; the error sizes and effects are in it too.
    options : MixedOptions

    Returns
    -------
    MixedFit
        Its covariance includes the shared effects and is conditional on the estimated error sizes.

    Raises
    ------
    NotObservableError
        If the observations and priors do not determine a combination of parameters, which are
        named; or if half of the observations contradict the rest.
    InvalidValueError
        If there is no observation.
    """
    count = len(observations.value)
    if count == 0:
        raise InvalidValueError("there is no observation", "fit")
    check_rank(_scaled_normal_matrix(observations, options), options.names)
    # The matrices are small: BLAS threads would slow it down.
    with one_blas_thread():
        state, solved = _reweight(observations, options)
    residual, conditional = _residuals(observations, solved)
    parameters = slice(observations.design.shape[2])
    return MixedFit(
        estimate=solved.solution[parameters],
        covariance=solved.joint[parameters, parameters],
        joint=solved.joint,
        residual=residual,
        conditional=conditional,
        effects=solved.effects_of(observations),
        weight=state.before,
        sizes=state.sizes,
        iterations=state.rounds,
        converged=state.converged,
        reason="weights converged"
        if state.converged
        else f"weights still changed after {state.rounds} rounds",
        moved=state.moved,
    )


def _reweight(observations: Observations, options: MixedOptions) -> tuple[_State, MixedEquations]:
    """Re-weight until the weights converge; return the equations with the last weights."""
    state = _State(np.ones(len(observations.value)), options.sizes)
    # Nothing is rejected before the weights have converged: a fit still biased by outliers would
    # reject good observations.
    for reject in (np.inf, options.reject):
        for _ in range(options.max_rounds):
            state = _round(observations, options, state, reject)
            if state.converged:
                break
        if not options.robust:
            break
    chosen, weight = observations.select(state.used), state.before[state.used]
    return state, MixedEquations.solved(chosen, weight, options, state.sizes)


@dataclass(frozen=True, eq=False)
class _State:
    """State of the re-weighting: weights after and before the last round, its estimate."""

    weight: FloatArray
    sizes: ErrorSizes
    before: FloatArray = field(default_factory=lambda: np.ones(0))
    rounds: int = 0
    converged: bool = False
    estimate: FloatArray = field(default_factory=lambda: np.zeros(0))
    moved: float = np.inf

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
    solved = MixedEquations.solved(chosen, weight, options, sizes)
    _, conditional = _residuals(observations, solved)
    new = state.weight
    if options.robust:
        new = _robust_weights(conditional, observations, sizes, reject)
    same_rejected = np.array_equal(new > 0, used)
    if np.count_nonzero(new) <= len(new) / 2:
        raise NotObservableError(
            f"the observations contradict one another: {np.count_nonzero(new)} of {len(new)} agree "
            f"within {reject:g} sigma",
            options.names,
            do="check the single matches: they may be of another body or another epoch",
        )
    converged = same_rejected and bool(np.max(np.abs(new - state.weight)) < 1e-3)
    estimate, moved = solved.solution[: observations.design.shape[2]], np.inf
    if state.estimate.size:
        sigma = np.sqrt(np.diag(solved.joint)[: len(estimate)])
        moved = float(np.max(np.abs(estimate - state.estimate) / sigma))
    return _State(new, sizes, state.weight, state.rounds + 1, converged, estimate, moved)


def _residuals(observations: Observations, solved: MixedEquations) -> tuple[FloatArray, FloatArray]:
    """Residuals (N, D) including the estimated shared effects, and without them."""
    estimate = solved.solution[: observations.design.shape[2]]
    residual = observations.value - np.einsum("ndp,p->nd", observations.design, estimate)
    conditional = residual
    for group, effect in zip(observations.effects, solved.effects_of(observations), strict=True):
        conditional = conditional - np.einsum("ndr,r->nd", group, effect)
    return residual, conditional


def _scaled_normal_matrix(observations: Observations, options: MixedOptions) -> FloatArray:
    """Scaled normal matrix (P, P) of the design alone, as if all observations had one sigma.

    A parameter with a prior counts as determined.
    """
    rows = (observations.design * options.scale).reshape(-1, len(options.scale))
    return rows.T @ rows / len(rows) + np.diag(np.isfinite(options.prior).astype(np.float64))


def _estimate_sizes(
    observations: Observations, weight: FloatArray, options: MixedOptions, start: ErrorSizes
) -> ErrorSizes:
    """Maximise the restricted likelihood over the error sizes that are not fixed."""
    prior = options.sizes.all
    fixed = np.isin(np.arange(len(prior)) - 1, options.sizes.fixed)
    free = np.flatnonzero((prior > 0) & ~fixed)
    if options.sizes.width <= 0 or not free.size:
        return start

    def likelihood(values: FloatArray) -> SizeLikelihood:
        sizes = _sized(start, free, values)
        every = MixedEquations.solved(observations, weight, options, sizes).likelihood()
        return SizeLikelihood(
            every.deviance, every.gradient[free], every.information[np.ix_(free, free)]
        )

    found = most_likely_sizes(
        likelihood, prior[free], width=options.sizes.width, start=start.all[free]
    )
    return _sized(start, free, found)


def _sized(sizes: ErrorSizes, free: AnyArray, values: FloatArray) -> ErrorSizes:
    """`sizes` with the `free` ones set."""
    every = sizes.all
    every[free] = values
    return replace(sizes, independent=float(every[0]), shared=tuple(every[1:].tolist()))


def _robust_weights(
    conditional: FloatArray, observations: Observations, sizes: ErrorSizes, reject: float
) -> FloatArray:
    """Huber weights (N,) from the residuals in units of their standard deviations."""
    solved = np.linalg.solve(spread_of(observations, sizes), conditional[..., None])[..., 0]
    distance = np.sqrt(np.einsum("ni,ni->n", conditional, solved) / conditional.shape[1])
    weights: FloatArray = huber_weight(distance, k=2.0)
    weights[distance > reject] = 0.0
    return weights
