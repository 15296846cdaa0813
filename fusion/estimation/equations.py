"""Henderson's mixed-model equations at given error sizes, and the restricted likelihood of these.

Shared effects are estimated as parameters with prior precision 1/σ_g², so that no covariance of
all observations is built. Docs: derivations §12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from fusion.estimation.values import ErrorSizes, MixedOptions, Observations
from spcola.arrays import FloatArray
from spcola.math.statistics import SizeLikelihood

__all__ = ["MixedEquations", "spread_of"]


@dataclass(frozen=True, eq=False)
class MixedEquations:
    """Equations of P parameters and R shared effects, solved.

    Attributes
    ----------
    sizes : ErrorSizes
        The error sizes; a group of size 0 has no effects.
    groups : tuple of slice or None
        Where the effects of each group are among all unknowns; None for a group of size 0.
    variance : (N,) ndarray
        Variance of the independent error of each observation, robust weight included.
    whitener : (N, D, D) ndarray
        Inverse Cholesky factors of the observations' covariances.
    rows : (N, D, P + R) ndarray
        Whitened design matrix.
    value : (N, D) ndarray
        Whitened observations.
    solution : (P + R,) ndarray
        Parameters, then effects of the groups of non-zero size.
    joint : (P + R, P + R) ndarray
        Covariance of the solution.
    deviance : float
        Minus twice the logarithm of the restricted likelihood, up to a constant.
    """

    sizes: ErrorSizes
    groups: tuple[slice | None, ...]
    variance: FloatArray
    whitener: FloatArray
    rows: FloatArray
    value: FloatArray
    solution: FloatArray
    joint: FloatArray
    deviance: float

    @classmethod
    def solved(
        cls,
        observations: Observations,
        weight: FloatArray,
        options: MixedOptions,
        sizes: ErrorSizes,
    ) -> MixedEquations:
        """Set up the equations and solve them.

        Parameters
        ----------
        observations : Observations
        weight : (N,) ndarray
            Robust weights, above 0.
        options : MixedOptions
        sizes : ErrorSizes
            Those for which the equations hold; a group of size 0 has no effects.

        Returns
        -------
        MixedEquations

        Raises
        ------
        numpy.linalg.LinAlgError
            If a parameter is not determined (:func:`fusion.estimation.check_rank`).
        """
        groups = _places(observations, sizes)
        design = np.concatenate(
            [observations.design]
            + [group for group, at in zip(observations.effects, groups, strict=True) if at],
            axis=2,
        )
        spread = spread_of(observations, sizes) / weight[:, None, None]
        whitener = np.linalg.inv(np.linalg.cholesky(spread))
        rows = np.einsum("nij,njp->nip", whitener, design)
        value = np.einsum("nij,nj->ni", whitener, observations.value)
        flat, count = rows.reshape(-1, design.shape[2]), observations.design.shape[2]
        own = np.zeros(design.shape[2] - count)
        for size, at in zip(sizes.shared, groups, strict=True):
            if at:
                own[at.start - count : at.stop - count] = size
        # Metres, radians and scales differ by many orders of magnitude: hence a unit diagonal.
        normal = flat.T @ flat + np.diag(1.0 / np.concatenate([options.prior, own]) ** 2)
        scale = 1.0 / np.sqrt(np.diag(normal))
        lower = np.linalg.cholesky(normal * np.outer(scale, scale))
        right = scale * (flat.T @ value.ravel())
        explained = solve_triangular(lower, right, lower=True)
        joint = cho_solve((lower, True), np.eye(len(scale))) * np.outer(scale, scale)
        deviance = (
            float(np.sum(value**2) - explained @ explained)
            - 2.0 * float(np.sum(np.log(np.einsum("nii->ni", whitener))))
            + 2.0 * float(np.sum(np.log(np.diag(lower) / scale)))
            + 2.0 * float(np.sum(np.log(own)))
        )
        solution = scale * cho_solve((lower, True), right)
        variance = sizes.independent**2 / weight
        return cls(sizes, groups, variance, whitener, rows, value, solution, joint, deviance)

    def effects_of(self, observations: Observations) -> tuple[FloatArray, ...]:
        """Return the effects of each group; those of a group of size 0 are 0.

        Parameters
        ----------
        observations : Observations
            With the groups of effects of those that were solved.

        Returns
        -------
        tuple of (R_g,) ndarrays
        """
        return tuple(
            np.zeros(group.shape[2]) if at is None else self.solution[at]
            for group, at in zip(observations.effects, self.groups, strict=True)
        )

    def likelihood(self) -> SizeLikelihood:
        """Return the deviance and its derivatives by the logarithms of all sizes.

        Returns
        -------
        SizeLikelihood
            Of 1 + G sizes: the independent error, then the groups.

        Notes
        -----
        The second derivatives are the average information of Gilmour et al. (1995): that of the
        working observations (∂V/∂ ln σ) P y, without a trace of large matrices.
        """
        left = self.value - self.rows @ self.solution
        # ∂S/∂ ln σ_m = 2 σ_m²/ω I, between the whiteners.
        change = 2.0 * self.variance
        weighted = np.einsum("nji,nj->ni", self.whitener, left)
        back = np.einsum("nji,njp->nip", self.whitener, self.rows).reshape(-1, self.rows.shape[2])
        back *= np.repeat(np.sqrt(change), left.shape[1])[:, None]
        gradient = [
            float(change @ np.sum(self.whitener**2, axis=(1, 2)))
            - float(np.sum((back.T @ back) * self.joint))
            - float(change @ np.sum(weighted**2, axis=1))
        ]
        working = [(change[:, None] * np.einsum("nij,nj->ni", self.whitener, weighted)).ravel()]
        flat = self.rows.reshape(left.size, -1)
        for size, at in zip(self.sizes.shared, self.groups, strict=True):
            if at is None:
                gradient.append(0.0)
                working.append(np.zeros(left.size))
                continue
            effect, variance = self.solution[at], np.diag(self.joint)[at]
            gradient.append(2.0 * float(np.sum(1.0 - (effect**2 + variance) / size**2)))
            working.append(2.0 * flat[:, at] @ effect)
        observed = np.array(working)
        explained = observed @ flat
        information = observed @ observed.T - explained @ self.joint @ explained.T
        return SizeLikelihood(self.deviance, np.array(gradient), information)


def spread_of(observations: Observations, sizes: ErrorSizes) -> FloatArray:
    """Covariance of each observation with the independent error added.

    Parameters
    ----------
    observations : Observations
    sizes : ErrorSizes

    Returns
    -------
    (N, D, D) ndarray
    """
    size = observations.value.shape[1]
    return observations.covariance + sizes.independent**2 * np.eye(size)


def _places(observations: Observations, sizes: ErrorSizes) -> tuple[slice | None, ...]:
    """Where the effects of each group are among the unknowns."""
    places: list[slice | None] = []
    start = observations.design.shape[2]
    for size, group in zip(sizes.shared, observations.effects, strict=True):
        stop = start + group.shape[2]
        places.append(slice(start, stop) if size > 0 else None)
        start = stop if size > 0 else start
    return tuple(places)
