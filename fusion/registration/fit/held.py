"""The equations of a fit at its own weights and error sizes: refits of parts of it cost little."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.estimation import MixedFit, Observations, check_rank
from spcola.arrays import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Refit:
    """How far a refit departs from the fit.

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
class HeldEquations:
    """Henderson's equations of the observations that a fit used, weights and sizes as it left them.

    Whatever is solved from them is a departure from the fit: the value is its residual.

    Attributes
    ----------
    design : (N, D, P) ndarray
        Partial derivatives of the observations used.
    rows : (N, D, P + R) ndarray
        The same with those by the shared effects, whitened.
    seen : (N, D) ndarray
        Residuals, shared effects not removed, whitened.
    precision : (P + R,) ndarray
        1/σ² of each effect; 0 for parameters.
    """

    design: FloatArray
    rows: FloatArray
    seen: FloatArray
    precision: FloatArray

    @classmethod
    def of(cls, observations: Observations, fit: MixedFit, design: FloatArray) -> HeldEquations:
        """Whiten what `fit` used of `observations`; `design` (N, D, P) may be of another model."""
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
            design=design[used],
            rows=whitener @ both,
            seen=np.einsum("nij,nj->ni", whitener, fit.residual[used]),
            precision=np.concatenate([np.zeros(design.shape[2]), *precision]),
        )

    @property
    def parameters(self) -> int:
        """P."""
        return self.design.shape[2]

    def normal(self, chosen: BoolArray | AnyArray) -> tuple[FloatArray, FloatArray]:
        """Normal matrix (P + R, P + R) and right side (P + R,) of some observations alone."""
        rows = self.rows[chosen].reshape(-1, self.rows.shape[2])
        return rows.T @ rows, rows.T @ self.seen[chosen].ravel()

    def refit(self, chosen: BoolArray, names: tuple[str, ...]) -> Refit:
        """Solve with the chosen observations (mask over those used) alone.

        Raises
        ------
        NotObservableError
            If they leave a parameter free; `names` (P,) name it.
        """
        rows = self.design[chosen].reshape(-1, self.parameters)
        size = np.sqrt(np.sum(rows**2, axis=0))
        unit = rows / np.where(size > 0, size, 1.0)
        check_rank(unit.T @ unit, names)
        normal, right = self.normal(chosen)
        return self.solved(normal, right)

    def solved(self, normal: FloatArray, right: FloatArray) -> Refit:
        """Solve summed equations, to which the sizes of the effects are added."""
        whole = normal + np.diag(self.precision)
        scale = 1.0 / np.sqrt(np.diag(whole))
        inverse = np.linalg.inv(whole * np.outer(scale, scale)) * np.outer(scale, scale)
        count = self.parameters
        return Refit((inverse @ right)[:count], inverse[:count, :count])
