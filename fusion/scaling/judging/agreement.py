"""Test whether ε and the scale of the registration agree, given their covariance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import special

from spcola.arrays import FloatArray


def covariance_by_maplets(
    of_epsilon: FloatArray, of_scale: FloatArray, center_sigma: FloatArray
) -> float:
    """Covariance of ε and the registration's scale by errors of the centres of M maplets.

    `of_epsilon` and `of_scale` (M, 3) are the derivatives by displacements of each maplet, 1/m;
    `center_sigma` (M, 3) are the standard deviations of the centres, metres.
    """
    return float(np.sum(of_epsilon * center_sigma**2 * of_scale))


def consistency(
    scale: Mapping[str, Any], registration: Mapping[str, Any], covariance: float | None = None
) -> dict[str, Any]:
    """Compare the scale of the registration with ε: (1 + ε) · scale should be 1.

    Parameters
    ----------
    scale, registration : mapping
        Content of ``scale.json`` and ``registration.json``.
    covariance : float, optional
        Of ε and the registration's scale. Without it the sigma of the difference is its upper
        bound, the sum of both sigmas.

    Returns
    -------
    dict
        `difference` (1 + ε) · scale − 1, its sigma, z, the two-sided p-value (with a bound: its
        upper limit), the joint `covariance` of ε and scale, and `sigma_is`: "joint" or "bound".
        With a joint covariance also `epsilon_of_both` and its sigma: the minimum-variance mean of ε
        and 1/scale − 1.
    """
    if scale["epsilon"] is None:
        keys = ("difference", "difference_sigma", "z", "p_value", "covariance", "sigma_is")
        return dict.fromkeys((*keys, "epsilon_of_both", "epsilon_of_both_sigma"))
    own, other = float(scale["epsilon_sigma"]), float(registration["scale_sigma"])
    product = (1.0 + float(scale["epsilon"])) * float(registration["scale"]) - 1.0
    shared = own * other if covariance is None else covariance
    sigma = float(np.sqrt(max(own**2 + other**2 + 2.0 * shared, 0.0)))
    z = product / sigma if sigma > 0 else float("nan")
    both, both_sigma = _of_both(scale, registration, covariance)
    return {
        "epsilon_of_both": both,
        "epsilon_of_both_sigma": both_sigma,
        "difference": product,
        "difference_sigma": sigma,
        "z": z,
        "p_value": float(2.0 * special.ndtr(-abs(z))),
        "covariance": None
        if covariance is None
        else [[own**2, covariance], [covariance, other**2]],
        "sigma_is": "bound" if covariance is None else "joint",
    }


def _of_both(
    scale: Mapping[str, Any], registration: Mapping[str, Any], covariance: float | None
) -> tuple[float | None, float | None]:
    """Minimum-variance mean of ε and 1/scale − 1 of the registration, and its sigma."""
    own, other = float(scale["epsilon_sigma"]), float(registration["scale_sigma"])
    # A covariance larger than the sigmas allow belongs to other fits.
    if covariance is None or not abs(covariance) < own * other:
        return None, None
    values = np.array([float(scale["epsilon"]), 1.0 / float(registration["scale"]) - 1.0])
    # A larger scale is a smaller ε.
    spread = np.array([[own**2, -covariance], [-covariance, other**2]])
    weights = np.linalg.solve(spread, np.ones(2))
    return float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
