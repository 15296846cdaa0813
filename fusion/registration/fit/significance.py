"""Tests of parameters that the fitted model lacks: shear, non-uniform scale, scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.registration.fit.fit import Registration
from fusion.registration.fit.fixed_weights import FixedWeightEquations, Refit
from fusion.registration.transform import PARAMETERS, Model
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError
from spcola.math.statistics import chi_square_tail

# Rows that take a matrix to xx − mean, yy − mean, xy, xz, yz of its symmetric part.
_STRAIN_ROWS = np.zeros((5, 9))
_STRAIN_ROWS[0, [0, 4, 8]] = [2 / 3, -1 / 3, -1 / 3]
_STRAIN_ROWS[1, [0, 4, 8]] = [-1 / 3, 2 / 3, -1 / 3]
_STRAIN_ROWS[[2, 3, 4], [1, 2, 5]] = _STRAIN_ROWS[[2, 3, 4], [3, 6, 7]] = 0.5


@dataclass(frozen=True, eq=False)
class Departure:
    """K numbers that are 0 if the simpler model is true.

    Attributes
    ----------
    estimate : (K,) ndarray
        NaN where they cannot be observed.
    covariance : (K, K) ndarray
    reason : str
        Why they cannot be observed; empty if they can.
    """

    estimate: FloatArray
    covariance: FloatArray
    reason: str = ""

    @classmethod
    def unobserved(cls, count: int, reason: str) -> Departure:
        """Return `count` numbers that are not observed."""
        return cls(np.full(count, np.nan), np.full((count, count), np.nan), reason)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations (K,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def chi2(self) -> float:
        """``eᵀ C⁻¹ e``: χ² with K degrees of freedom if the simpler model is true."""
        return float(self.estimate @ np.linalg.solve(self.covariance, self.estimate))

    def test(self) -> dict[str, Any]:
        """Statistic, degrees of freedom, p-value and reason, as ``registration.json`` has them."""
        statistic = float("nan") if self.reason else self.chi2
        return {
            "chi2": statistic,
            "degrees_of_freedom": len(self.estimate),
            "p_value": chi_square_tail(statistic, len(self.estimate)),
            "reason": self.reason,
        }


def strain_departure(registration: Registration) -> Departure:
    """Shear and non-uniform scale (5,): xx − mean, yy − mean, xy, xz, yz of the symmetric strain.

    Of an affine fit they are its own. Else the affine parameters are estimated from the residuals
    at the fit's weights and error sizes (the score test of Rao 1948). If there is a strain it has
    increased those sizes, so that the sigmas are conservative.

    Returns
    -------
    Departure
        Axes of the lidar frame, dimensionless.
    """
    similarity = registration.similarity
    rows = _STRAIN_ROWS @ np.kron(similarity.rotation.T / similarity.scale, np.eye(3))
    if registration.model == "affine":
        covariance = rows @ registration.covariance[3:, 3:] @ rows.T
        return Departure(rows @ registration.transform.matrix.ravel(), covariance)
    found = _refitted(registration, "affine")
    if isinstance(found, str):
        return Departure.unobserved(len(_STRAIN_ROWS), found)
    return Departure(rows @ found.change[3:], rows @ found.covariance[3:, 3:] @ rows.T)


def scale_departure(registration: Registration) -> Departure:
    """Scale minus 1 (1,): fitted, or for a rigid fit estimated from the residuals."""
    if registration.model != "rigid":
        scale, sigma, _, _ = registration.similarity_numbers()
        return Departure(np.array([scale - 1.0]), np.array([[sigma**2]]))
    found = _refitted(registration, "similarity")
    if isinstance(found, str):
        return Departure.unobserved(1, found)
    return Departure(found.change[6:], found.covariance[6:, 6:])


def departures_json(registration: Registration) -> dict[str, Any]:
    """Return the `tests` of ``registration.json``."""
    strain = strain_departure(registration)
    scale = scale_departure(registration)
    return {
        "strain": {
            "strain": strain.estimate,
            "strain_sigma": strain.sigma,
            "strain_z": strain.estimate / strain.sigma,
            **strain.test(),
        },
        "scale": {
            "scale_minus_1": scale.estimate[0],
            "scale_sigma": scale.sigma[0],
            **scale.test(),
        },
    }


def _refitted(registration: Registration, model: Model) -> Refit | str:
    """Solve for the parameters of a wider model at the fit, or return why that is not possible."""
    names = PARAMETERS[model]
    count = int(np.count_nonzero(registration.fit.used))
    if 3 * count < len(names):
        return f"{count} mapolas give {3 * count} numbers for {len(names)} parameters"
    try:
        return FixedWeightEquations.of(registration, model).refit(np.ones(count, dtype=bool))
    except NotObservableError as error:
        return str(error)
