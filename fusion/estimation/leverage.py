"""How much each observation of a fit moves its estimate, and what two fits share by that."""

from __future__ import annotations

import numpy as np

from fusion.estimation.mixed import MixedFit, Observations
from spcola.arrays import FloatArray


def influence(observations: Observations, fit: MixedFit) -> FloatArray:
    """Change of the estimate (P, N, D) for a change of each value, at the fit's weights and sizes.

    Parameters
    ----------
    observations : Observations
    fit : MixedFit
        Of them; with `joint` the inverse of the normal matrix of parameters and effects, the
        estimate is ``joint · [A Z]ᵀ S⁻¹ y`` (docs: derivations §12), which is linear in y.

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
