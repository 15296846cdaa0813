"""Sizes of errors estimated with the parameters, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# Bound on the logarithm of a size, relative to the prior's median: exp(−10) is practically 0.
_REACH = 10.0
_MOST_STEPS = 200
# A step of the logarithms smaller than this is the last one: the next would be of its square.
_LAST_STEP = 1e-2
# Rounding errors of a deviance, relative to it.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class SizeLikelihood:
    """A restricted likelihood of K sizes of errors, and its derivatives by their logarithms.

    Parameters
    ----------
    deviance : float
        Minus twice the logarithm of the likelihood, up to a constant.
    gradient : (K,) ndarray
        First derivatives of the deviance.
    information : (K, K) ndarray
        Average information, an approximation of the second derivatives (Gilmour et al. 1995).
    """

    deviance: float
    gradient: FloatArray
    information: FloatArray

    def with_prior(self, away: FloatArray, width: FloatArray | float) -> SizeLikelihood:
        """Return the posterior by a log-normal prior.

        Parameters
        ----------
        away : (K,) ndarray
            Logarithms of the sizes over the median of the prior.
        width : float or (K,) ndarray
            Standard deviation of the natural logarithm.

        Returns
        -------
        SizeLikelihood
        """
        # A variance is quadratic in the logarithm's exponential: the second derivative contains
        # twice the first one. Only its positive part is used, so that every step descends.
        curvature = 2.0 / np.square(width) + 2.0 * np.maximum(self.gradient, 0.0)
        return SizeLikelihood(
            self.deviance + float(np.sum((away / width) ** 2)),
            self.gradient + 2.0 * away / np.square(width),
            self.information + np.diag(curvature),
        )


def most_likely_sizes(
    likelihood: Callable[[FloatArray], SizeLikelihood],
    median: FloatArray,
    *,
    width: FloatArray | float,
    start: FloatArray,
) -> FloatArray:
    """Maximise a restricted likelihood with a log-normal prior over K sizes of errors.

    Patterson & Thompson (1971): the estimate allows for the degrees of freedom of the other
    parameters. By Newton's method with the average information (Gilmour et al. 1995), steps
    shortened until the deviance falls.

    Parameters
    ----------
    likelihood : callable
        Likelihood of sizes (K,).
    median : (K,) ndarray
        Median of the prior.
    width : float or (K,) ndarray
        Standard deviation of the natural logarithm.
    start : (K,) ndarray
        Start of the search.

    Returns
    -------
    (K,) ndarray

    Raises
    ------
    NotObservableError
        If the search does not converge.
    """
    center = np.log(median)

    def at(logs: FloatArray) -> SizeLikelihood:
        return likelihood(np.exp(logs)).with_prior(logs - center, width)

    logs = np.clip(np.log(start), center - _REACH, center + _REACH)
    here = at(logs)
    for _ in range(_MOST_STEPS):
        step = -np.linalg.solve(here.information, here.gradient)
        step /= max(1.0, float(np.max(np.abs(step))))
        step = np.clip(logs + step, center - _REACH, center + _REACH) - logs
        if np.max(np.abs(step)) < _LAST_STEP:
            return np.exp(logs + step)
        there = at(logs + step)
        while there.deviance > here.deviance + _ROUNDING * abs(here.deviance):
            step = step / 4.0
            there = at(logs + step)
        logs, here = logs + step, there
    raise NotObservableError(
        f"the sizes of errors still change by {np.max(np.abs(step)):.0%} after {_MOST_STEPS} steps",
        where="fit",
    )
