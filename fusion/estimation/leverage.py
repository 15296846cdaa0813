"""Influence of each observation of a fit on its estimate."""

from __future__ import annotations

import numpy as np

from fusion.estimation.values import MixedFit, Observations
from spcola.arrays import FloatArray


def influence(observations: Observations, fit: MixedFit) -> FloatArray:
    """Return ∂estimate/∂value (P, N, D) at the fit's weights and error sizes.

    Parameters
    ----------
    observations : Observations
    fit : MixedFit
        Fit of `observations`. With `joint`, the inverse of the normal matrix of parameters and
        effects, the estimate is ``joint · [A Z]ᵀ S⁻¹ y`` (docs: derivations §12), linear in y.

    Returns
    -------
    (P, N, D) ndarray
        0 for observations that were rejected.
    """
    count, size = observations.value.shape
    used = fit.used
    groups = [
        group
        for group, strength in zip(observations.effects, fit.sizes.shared, strict=True)
        if strength > 0
    ]
    design = np.concatenate([observations.design, *groups], axis=2)[used]
    spread = observations.covariance[used] + fit.sizes.independent**2 * np.eye(size)
    rows = np.linalg.solve(spread / fit.weight[used][:, None, None], design)
    parameters = len(fit.estimate)
    moved = np.zeros((parameters, count, size))
    moved[:, used] = np.einsum("pq,ndq->pnd", fit.joint[:parameters], rows)
    return moved
