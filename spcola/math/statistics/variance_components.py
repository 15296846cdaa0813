"""Sizes of errors estimated with the parameters, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from spcola.arrays import FloatArray

_MOST_STEPS = 200


def most_likely_sizes(
    deviance: Callable[[FloatArray], float],
    median: FloatArray,
    *,
    width: FloatArray | float,
    start: FloatArray,
    steps: FloatArray,
    reach: float,
    tolerance: tuple[float, float],
) -> FloatArray:
    """Maximise a restricted likelihood with a log-normal prior over K sizes of errors.

    Patterson & Thompson (1971): the estimate allows for the degrees of freedom of the other
    parameters. By a simplex, as the deviance is noisy at its last digits and K is 1 to 3.

    Parameters
    ----------
    deviance : callable
        Minus twice the logarithm of the likelihood, of sizes (K,).
    median : (K,) ndarray
        Median of the prior.
    width : float or (K,) ndarray
        Standard deviation of the natural logarithm.
    start : (K,) ndarray
        Start of the search.
    steps : (K,) ndarray
        First steps of the logarithms.
    reach : float
        Largest distance of the logarithms from the median's; exp(−reach) is practically 0.
    tolerance : (float, float)
        Tolerances of the logarithms, and of the deviance.

    Returns
    -------
    (K,) ndarray
    """
    center = np.log(median)

    def sizes(logs: FloatArray) -> FloatArray:
        return np.exp(np.clip(logs, center - reach, center + reach))

    def cost(logs: FloatArray) -> float:
        return deviance(sizes(logs)) + float(np.sum(((logs - center) / width) ** 2))

    begin = np.log(np.maximum(start, 1e-12))
    found = minimize(
        cost,
        begin,
        method="Nelder-Mead",
        options={
            "xatol": tolerance[0],
            "fatol": tolerance[1],
            "maxiter": _MOST_STEPS,
            "initial_simplex": np.vstack([begin, begin + np.diag(steps)]),
        },
    )
    return sizes(found.x)
