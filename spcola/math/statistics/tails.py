"""Tails of distributions, without ``scipy.stats``: to import that takes a third of a second."""

from __future__ import annotations

from scipy import special


def chi_square_tail(value: float, count: int) -> float:
    """Return the probability that χ² with `count` degrees of freedom exceeds `value`.

    Parameters
    ----------
    value : float
        1 is returned below zero, NaN if it is NaN.
    count : int
        NaN is returned unless it is positive.

    Returns
    -------
    float
    """
    if count < 1:
        return float("nan")
    return float(special.chdtrc(count, 0.0 if value < 0.0 else value))
