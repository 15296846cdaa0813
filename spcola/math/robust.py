"""Robust scale and weights: median deviations, Huber, Cauchy, Tukey."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray

__all__ = [
    "HUBER",
    "MAD_TO_SIGMA",
    "TUKEY",
    "biweight",
    "cauchy_weight",
    "huber_solution",
    "huber_weight",
    "mad",
]

_ROUNDS = 4
# Largest condition number of a normal matrix scaled to a unit diagonal.
_LARGEST_CONDITION = 1e10

MAD_TO_SIGMA = 1.482602218505602
"""1 / Φ⁻¹(3/4): makes the median absolute deviation of a normal sample its standard deviation."""


def mad(values: ArrayLike, axis: int | None = None) -> FloatArray:
    """Return the scaled median absolute deviation from the median, ignoring NaN.

    Parameters
    ----------
    values : array_like
        Any shape, any unit; NaN counts as absent.
    axis : int, optional
        Axis to reduce; all values by default.

    Returns
    -------
    ndarray
        1.4826 × MAD, in the unit of `values`: the standard deviation if they are normal. NaN
        where no value is known. Without `axis` a 0-d array.
    """
    array = np.asarray(values, dtype=np.float64)
    if axis is None:
        array, axis = array.ravel(), 0
    deviation = np.abs(array - np.expand_dims(known_median(array, axis), axis))
    return MAD_TO_SIGMA * known_median(deviation, axis)


HUBER = 1.345
"""Standard deviations beyond which Huber's estimate gives a residual less weight."""


def huber_weight(z: ArrayLike, k: float = HUBER) -> FloatArray:
    """Return Huber's weights: 1 for ``|z| ≤ k``, then ``k/|z|`` (95 % efficient with k = 1.345).

    `z` are residuals over their standard deviation; NaN gets weight 0.
    """
    size = np.abs(np.asarray(z, dtype=np.float64))
    weight = k / np.maximum(size, k)
    return np.where(np.isnan(size), 0.0, weight)


def cauchy_weight(z: ArrayLike, k: float = 2.385) -> FloatArray:
    """Return Cauchy's weights 1 / (1 + (z/k)²) (95 % efficient with k = 2.385).

    `z` are residuals over their standard deviation; NaN gets weight 0.
    """
    ratio = np.asarray(z, dtype=np.float64) / k
    weight = 1.0 / (1.0 + ratio * ratio)
    return np.where(np.isnan(ratio), 0.0, weight)


def huber_solution(rows: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the solution (P,) of `rows` (N, P) · p = `values` (N,), and Huber's weights (N,).

    Weights are those of residuals over their median deviation, iterated for a few rounds.


    Returns
    -------
    tuple or None
        None where columns are linearly dependent, or one of them is 0.
    """
    weight: FloatArray = np.ones(len(rows))
    solution: FloatArray = np.zeros(rows.shape[1])
    scale = np.sqrt(np.mean(rows**2, axis=0))
    if not np.min(scale) > 1e-12 * np.max(scale):
        return None
    unit = rows / scale
    for _ in range(_ROUNDS):
        weighted = unit * weight[:, None]
        normal = weighted.T @ unit
        if np.linalg.cond(normal) > _LARGEST_CONDITION:
            return None
        solution = np.linalg.solve(normal, weighted.T @ values)
        rest = values - unit @ solution
        spread = float(mad(rest))
        if spread <= 1e-12 * float(np.max(np.abs(values), initial=0.0)):
            break
        weight = huber_weight(rest / spread)
    return solution / scale, weight


TUKEY = 4.685
"""Standard deviations beyond which Tukey's estimate gives a residual no weight."""


def biweight(z: ArrayLike) -> FloatArray:
    """Return Tukey's weights (1 − (z/c)²)², 0 beyond c = 4.685 (95 % efficient).

    `z` are residuals over their standard deviation; NaN gets weight 0. Outliers on one side have
    no influence at all, but the start must be good: begin with :func:`huber_weight`.
    """
    ratio = np.minimum(np.abs(np.asarray(z, dtype=np.float64)) / TUKEY, 1.0)
    weight: FloatArray = (1.0 - ratio * ratio) ** 2
    return np.where(np.isnan(ratio), 0.0, weight)


def known_median(array: FloatArray, axis: int = 0) -> FloatArray:
    """Return the median of the values that are not NaN along an axis; NaN where there is none.

    ``numpy.nanmedian`` warns of slices without a value, which are an ordinary case here (a
    cell without returns), and its warning filter is not safe in threads.

    Parameters
    ----------
    array : ndarray
    axis : int, optional

    Returns
    -------
    ndarray
        Without the axis.
    """
    if array.ndim == 1 and array.size:
        # Many times as fast as a sort and the indices of the general case.
        known = array.size - int(np.count_nonzero(np.isnan(array)))
        below, above = max(known - 1, 0) // 2, min(known // 2, array.size - 1)
        parted = np.partition(array, [below, above])  # NaN last
        return np.asarray((parted[below] + parted[above]) / 2.0)
    ordered = np.sort(array, axis=axis)  # NaN last
    count = np.expand_dims(np.sum(~np.isnan(array), axis=axis), axis)
    if ordered.shape[axis] == 0:
        return np.full(np.delete(array.shape, axis), np.nan)
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, ordered.shape[axis] - 1), axis)
    return np.squeeze((low + high) / 2.0, axis)
