"""What a fit of the parameters of the scale leaves of single shots at one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import mad

# Residuals that scatter by less than this are as good as none.
_LEAST_M = 1e-6
# Residuals beyond this many robust deviations are of outliers.
_CLIPPED = 4.0


@dataclass(frozen=True, eq=False)
class PlaceFit:
    """N shots at one place: values and partials of the M of them that meet the shape.

    Parameters
    ----------
    met : (N,) ndarray
        Which of the shots meet the shape.
    value : (M,) ndarray
        Measured minus predicted range, metres.
    design : (M, 8) ndarray
        Partial derivatives with respect to the parameters of the estimate.
    """

    met: BoolArray
    value: FloatArray
    design: FloatArray

    @property
    def error(self) -> float:
        """Robust standard deviation of the values, by which the priors are weighed, metres."""
        return max(float(mad(self.value)), _LEAST_M)

    def rest(self, prior: FloatArray) -> FloatArray:
        """Residuals (N,) of the fit with priors (8,), metres; NaN of shots that miss."""
        rest = np.full(len(self.met), np.nan)
        if not self.met.any():
            return rest
        rows = np.concatenate([self.design, np.diag(self.error / prior)])
        seen = np.concatenate([clipped(self.value), np.zeros(len(prior))])
        # Metres, radians and ratios: in units of the priors the columns are of one size.
        estimate = prior * np.linalg.lstsq(rows * prior, seen, rcond=None)[0]
        rest[self.met] = self.value - self.design @ estimate
        return rest

    def trimmed(self, prior: FloatArray) -> PlaceFit:
        """Without the shots that a fit with priors (8,) leaves as outliers."""
        rest = self.rest(prior)[self.met]
        good = clipped(rest) == rest
        met = self.met.copy()
        met[self.met] = good
        return PlaceFit(met, self.value[good], self.design[good])

    def squares(self, prior: FloatArray, noise: FloatArray, here: FloatArray) -> FloatArray:
        """Mean squares of what the fit leaves with other noise in the place of the residuals.

        Parameters
        ----------
        prior : (8,) ndarray
            Of the parameters.
        noise : (N, S) ndarray
            S series of noise, metres; 0 where `here` is not known.
        here : (N,) ndarray
            Residuals that each of them replaces, metres; NaN where not known.

        Returns
        -------
        (S,) ndarray
            Square metres.
        """
        known, both = np.isfinite(here[self.met]), self.met & np.isfinite(here)
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
    """Standard deviation of residuals (N,), outliers clipped; NaN where none is known."""
    known = rest[np.isfinite(rest)]
    return float(np.std(clipped(known))) if known.size else float("nan")


def clipped(rest: FloatArray) -> FloatArray:
    """Residuals (N,) clipped at four robust deviations from their median."""
    middle, limit = np.median(rest), _CLIPPED * float(mad(rest))
    return rest if not limit > 0 else np.clip(rest, middle - limit, middle + limit)
