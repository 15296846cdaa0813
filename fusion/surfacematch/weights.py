"""Relative weights of the points of two surfaces."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray

BEST_SHARE = 0.1
"""Share of the points, the most accurate, that have equal weight.

A few points with far smaller sigmas than the rest, or 0, must not dominate a match.
"""


def accurate_variance(variance: FloatArray) -> float:
    """Return the variance below which points have equal weight; see :data:`BEST_SHARE`.

    `variance` (N,) are those of the points' height differences, square metres.
    """
    return float(np.quantile(variance, BEST_SHARE))
