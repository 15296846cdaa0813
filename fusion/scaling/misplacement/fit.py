"""Residuals of single shots at one place, after a fit of the parameters of the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import mad

# Smallest scatter of residuals, metres.
_LEAST_M = 1e-6
# Residuals beyond this many robust standard deviations are outliers.
_CLIPPED = 4.0


@dataclass(frozen=True, eq=False)
class PlaceFit:
    """N shots at one place, with values and partials of the M shots that hit the shape.

    Parameters
    ----------
    hits : (N,) ndarray
        Mask of the shots that hit the shape.
    value : (M,) ndarray
        Measured minus predicted range, metres.
    design : (M, 8) ndarray
        Partial derivatives with respect to the parameters of the estimate.
    """

    hits: BoolArray
    value: FloatArray
    design: FloatArray

    @property
    def error(self) -> float:
        """Robust standard deviation of the values, metres, used as their sigma in fits."""
        return max(float(mad(self.value)), _LEAST_M)

    def rest(self, prior: FloatArray) -> FloatArray:
        """Residuals (N,) of the fit with priors (8,), metres; NaN for shots that miss."""
        rest = np.full(len(self.hits), np.nan)
        if not self.hits.any():
            return rest
        rows = np.concatenate([self.design, np.diag(self.error / prior)])
        values = np.concatenate([clipped(self.value), np.zeros(len(prior))])
        # In units of the priors, columns in metres, radians and ratios have similar sizes.
        estimate = prior * np.linalg.lstsq(rows * prior, values, rcond=None)[0]
        rest[self.hits] = self.value - self.design @ estimate
        return rest

    def trimmed(self, prior: FloatArray) -> PlaceFit:
        """Return it without the outliers of a fit with priors (8,)."""
        rest = self.rest(prior)[self.hits]
        good = clipped(rest) == rest
        hits = self.hits.copy()
        hits[self.hits] = good
        return PlaceFit(hits, self.value[good], self.design[good])

    def squares(self, prior: FloatArray, noise: FloatArray, here: FloatArray) -> FloatArray:
        """Mean squared residuals of the fit if the residuals `here` are replaced by noise.

        Parameters
        ----------
        prior : (8,) ndarray
            Prior sigmas of the parameters.
        noise : (N, S) ndarray
            S series of noise, metres; 0 where `here` is not known.
        here : (N,) ndarray
            Residuals to be replaced, metres; NaN where not known.

        Returns
        -------
        (S,) ndarray
            Square metres.
        """
        known, both = np.isfinite(here[self.hits]), self.hits & np.isfinite(here)
        fixed = np.zeros(len(here))
        fixed[both] = self.value[known] - here[both]
        columns = np.zeros((len(here), len(prior)))
        columns[both] = self.design[known] * (prior / self.error)
        # With K = AᵀA + 1 a fit leaves x − A K⁻¹ Aᵀ x, of square x·x − xᵀ A (K⁻¹ + K⁻²) Aᵀ x.
        inverse = np.linalg.inv(columns.T @ columns + np.eye(len(prior)))
        columns = columns @ np.linalg.cholesky(inverse + inverse @ inverse)
        explained = (columns.T @ fixed)[:, None] + columns.T @ noise
        left = np.einsum("ns,ns->s", noise, noise) - np.sum(noise[~both] ** 2, axis=0)
        left += fixed @ fixed + 2.0 * (fixed @ noise)
        left -= np.einsum("ks,ks->s", explained, explained)
        squares: FloatArray = np.maximum(left, 0.0) / max(np.count_nonzero(both), 1)
        return squares


def scatter(rest: FloatArray) -> float:
    """Standard deviation of residuals (N,), outliers clipped; NaN if all are NaN."""
    known = rest[np.isfinite(rest)]
    return float(np.std(clipped(known))) if known.size else float("nan")


def clipped(rest: FloatArray) -> FloatArray:
    """Residuals (N,) clipped at four robust standard deviations from their median."""
    middle, limit = np.median(rest), _CLIPPED * float(mad(rest))
    return rest if not limit > 0 else np.clip(rest, middle - limit, middle + limit)
