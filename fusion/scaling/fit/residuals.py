"""Mean and scatter of the residuals of the scale."""

from __future__ import annotations

from typing import Any

import numpy as np

from fusion.estimation import MixedFit
from fusion.scaling.fit.observation import ScaleObservations
from spcola.arrays import FloatArray
from spcola.math.robust import mad


def after_fit(observations: ScaleObservations, fit: MixedFit) -> FloatArray:
    """Range residuals (N,), metres, that the eight parameters leave, shared errors in them."""
    return observations.in_range(fit.residual)


def residuals_json(observations: ScaleObservations, fit: MixedFit) -> dict[str, Any]:
    """Entry ``residuals``: of the pairs or shots used, as range differences, metres.

    ``measured_minus_predicted`` is before the fit, ``after_fit`` what its parameters leave. Each
    has `mean_m`, `std_m`, and beside them what strays do not pull: `median_m` and
    `robust_std_m` (1.4826 × median absolute deviation).
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
