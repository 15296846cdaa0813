"""Equations of a fit at its final weights and error sizes, for fast refits of subsets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.estimation import check_rank
from fusion.registration.fit.fit import Registration
from fusion.registration.transform import PARAMETERS, Model, transform_partials
from spcola.arrays import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Refit:
    """Difference of a refit from the fit.

    Attributes
    ----------
    change : (P,) ndarray
        Of the parameters, from those of the fit.
    covariance : (P, P) ndarray
        Of the refitted parameters, shared effects included.
    """

    change: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class FixedWeightEquations:
    """Henderson's equations of the observations used in a fit, at its weights and error sizes.

    Their solutions are differences from the fit, as the observed values are its residuals.

    Attributes
    ----------
    names : tuple of str
        The P parameters.
    design : (N, D, P) ndarray
        Partial derivatives of the observations used.
    rows : (N, D, P + R) ndarray
        Whitened partial derivatives, with those with respect to the shared effects.
    value : (N, D) ndarray
        Whitened residuals, shared effects not removed.
    precision : (P + R,) ndarray
        1/σ² of each effect; 0 for parameters.
    """

    names: tuple[str, ...]
    design: FloatArray
    rows: FloatArray
    value: FloatArray
    precision: FloatArray

    @classmethod
    def of(cls, registration: Registration, model: Model) -> FixedWeightEquations:
        """Whiten the observations used in a fit; `model` may be another than the fitted one."""
        observations, fit = registration.observations, registration.fit
        design = transform_partials(
            model, registration.similarity, registration.centers, registration.center
        )
        used, sizes = fit.used, fit.sizes
        size = observations.value.shape[1]
        spread = observations.covariance[used] + sizes.independent**2 * np.eye(size)
        whitener = np.linalg.inv(np.linalg.cholesky(spread / fit.weight[used][:, None, None]))
        groups = [
            (sigma, group[used])
            for sigma, group in zip(sizes.shared, observations.effects, strict=True)
            if sigma > 0
        ]
        both = np.concatenate([design[used], *(group for _, group in groups)], axis=2)
        precision = [np.full(group.shape[2], sigma**-2.0) for sigma, group in groups]
        return cls(
            names=PARAMETERS[model],
            design=design[used],
            rows=whitener @ both,
            value=np.einsum("nij,nj->ni", whitener, fit.residual[used]),
            precision=np.concatenate([np.zeros(design.shape[2]), *precision]),
        )

    def normal(self, chosen: BoolArray | AnyArray) -> tuple[FloatArray, FloatArray]:
        """Normal matrix (P + R, P + R) and right side (P + R,) of chosen observations."""
        rows = self.rows[chosen].reshape(-1, self.rows.shape[2])
        return rows.T @ rows, rows.T @ self.value[chosen].ravel()

    def refit(self, chosen: BoolArray) -> Refit:
        """Solve with the chosen observations (mask over those used) only.

        Raises
        ------
        NotObservableError
            If they do not determine a parameter.
        """
        rows = self.design[chosen].reshape(-1, len(self.names))
        size = np.sqrt(np.sum(rows**2, axis=0))
        unit = rows / np.where(size > 0, size, 1.0)
        check_rank(unit.T @ unit, self.names)
        normal, right = self.normal(chosen)
        return self.solved(normal, right)

    def solved(self, normal: FloatArray, right: FloatArray) -> Refit:
        """Solve summed equations, with the prior precision of the effects added."""
        whole = normal + np.diag(self.precision)
        scale = 1.0 / np.sqrt(np.diag(whole))
        inverse = np.linalg.inv(whole * np.outer(scale, scale)) * np.outer(scale, scale)
        count = len(self.names)
        return Refit((inverse @ right)[:count], inverse[:count, :count])
