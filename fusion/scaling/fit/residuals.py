"""Mean and scatter of the residuals of the scale estimate."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.estimation import MixedFit
from fusion.scaling.fit.observation import ScaleObservations
from spcola.arrays import FloatArray
from spcola.math.robust import mad


def after_fit(observations: ScaleObservations, fit: MixedFit) -> FloatArray:
    """Range residuals (N,), metres, after the fit of the eight parameters, with shared errors."""
    return observations.in_range(fit.residual)


def residuals_json(observations: ScaleObservations, fit: MixedFit) -> dict[str, Any]:
    """Return the entry ``residuals``: range differences of the pairs or shots used, metres.

    ``measured_minus_predicted`` is before the fit, ``after_fit`` after it. Each has `mean_m`,
    `std_m`, and the robust `median_m` and `robust_std_m` (1.4826 × median absolute deviation).
    """
    before = observations.in_range(observations.value)
    return {
        "measured_minus_predicted": _summary(before[fit.used]),
        "after_fit": _summary(after_fit(observations, fit)[fit.used]),
    }


def _summary(values: FloatArray) -> dict[str, float]:
    return {
        "mean_m": float(np.mean(values)),
        "std_m": float(np.std(values, ddof=1)) if len(values) > 1 else float("nan"),
        "median_m": float(np.median(values)),
        "robust_std_m": float(mad(values)),
    }
