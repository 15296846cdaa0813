"""Whether ε and the scale of the registration agree, with what the two share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import stats

from fusion.errorsizes import ErrorSizes
from fusion.influence import influence
from fusion.mixed import MixedOptions, Observations, fit_mixed
from fusion.registration.fit import PARAMETERS, transform_partials
from fusion.registration.summary import transform_of
from spcola.arrays import FloatArray


def registration_influence(
    registration: Mapping[str, Any], effects: FloatArray, beside: FloatArray
) -> FloatArray:
    """Change (N, 3) of the registration's scale for a displacement of each mapola it used, 1/m.

    The fit of ``registration.json`` is set up again from what the file holds: centres, sigmas of
    the matches, error sizes. Robust weights and correlations of a match's components are not in
    it, and taken as 1 and 0; that images tell part of a maplet's error is left out, which makes
    what it shares with ε larger than it is.

    Parameters
    ----------
    registration : mapping
        Content of ``registration.json`` of a similarity.
    effects : (N, 3, M) ndarray
        What patterns of scan errors do to the mapolas used, in their order, metres.
    beside : (N, 3, 3) ndarray
        Covariance of what scans do to them beside, m².
    """
    entries = [entry for entry in registration["per_mapola"] if entry["used"]]
    centers = np.array([entry["center_m"] for entry in entries])
    sigma = np.array([entry["sigma_m"] for entry in entries])
    names = PARAMETERS["similarity"]
    landmarks = registration.get("landmarks") or {"own_sigma_m": 0.0}
    alone = np.hypot(float(registration["maplet_sigma_m"]), float(landmarks["own_sigma_m"]))
    similarity = transform_of(registration, "registration.json").nearest_similarity()
    # About their mean, as it was fitted: the scale is the same about any point.
    middle = centers.mean(axis=0)
    observations = Observations(
        np.zeros((len(centers), 3)),
        transform_partials("similarity", similarity, centers, middle),
        beside + sigma[:, :, None] ** 2 * np.eye(3),
        (effects,),
    )
    reach = float(np.sqrt(np.mean(np.sum((centers - middle) ** 2, axis=1))))
    options = MixedOptions(
        prior=np.full(len(names), np.inf),
        sizes=ErrorSizes(float(alone), (1.0,), width=0.0),
        scale=np.where([name.endswith("_m") for name in names], 1.0, 1.0 / max(reach, 1.0)),
        names=names,
        robust=False,
    )
    return influence(observations, fit_mixed(observations, options))[names.index("scale")]


def shared_by_maplets(
    of_epsilon: FloatArray, of_scale: FloatArray, center_sigma: FloatArray
) -> float:
    """Covariance of ε and the registration's scale by errors of the centres of M maplets.

    Parameters
    ----------
    of_epsilon, of_scale : (M, 3) ndarray
        Change of either for a displacement of each maplet, body-fixed, 1/m.
    center_sigma : (M, 3) ndarray
        Standard deviation of the centres, metres.
    """
    return float(np.sum(of_epsilon * center_sigma**2 * of_scale))


def consistency(
    scale: Mapping[str, Any], registration: Mapping[str, Any], covariance: float | None = None
) -> dict[str, Any]:
    """Compare the scale of the registration with ε: (1 + ε) · scale is to be 1.

    Parameters
    ----------
    scale, registration : mapping
        Content of ``scale.json`` and ``registration.json``.
    covariance : float, optional
        Of ε and the registration's scale. Without it nothing is known of how they err together,
        and the sigma of the difference is the largest that it can be, the sum of both.

    Returns
    -------
    dict
        `difference` (1 + ε) · scale − 1, its sigma, z, the two-sided p-value (at least that, with
        a bound), the joint `covariance` of ε and scale, and `sigma_is`: "joint" or "bound". With
        a joint covariance `epsilon_of_both` and its sigma too: the mean of ε and 1/scale − 1 of
        least variance.
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
        "p_value": float(2.0 * stats.norm.sf(abs(z))),
        "covariance": None
        if covariance is None
        else [[own**2, covariance], [covariance, other**2]],
        "sigma_is": "bound" if covariance is None else "joint",
    }


def _of_both(
    scale: Mapping[str, Any], registration: Mapping[str, Any], covariance: float | None
) -> tuple[float | None, float | None]:
    """The mean of ε and of what the registration says of it, of least variance, and its sigma."""
    own, other = float(scale["epsilon_sigma"]), float(registration["scale_sigma"])
    # A covariance that the sigmas do not allow is of other fits than these.
    if covariance is None or not abs(covariance) < own * other:
        return None, None
    values = np.array([float(scale["epsilon"]), 1.0 / float(registration["scale"]) - 1.0])
    # A larger scale is a smaller ε.
    spread = np.array([[own**2, -covariance], [-covariance, other**2]])
    weights = np.linalg.solve(spread, np.ones(2))
    return float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
