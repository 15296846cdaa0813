"""Covariance of a robust estimate on a grid whose residuals are correlated between neighbours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from spcola.arrays import FloatArray
from spcola.grids.correlation import autocovariance, correlated_cells, padded_size, usable_reach
from spcola.math.robust import HUBER, TUKEY, biweight

__all__ = [
    "RobustCovariance",
    "Scores",
    "biweight_scores",
    "huber_scores",
    "robust_covariance",
]


class Scores(NamedTuple):
    """Scores of residuals, ψ(e), and their derivatives, ψ′(e).

    Parameters
    ----------
    pull : ndarray
        ψ(e).
    slope : ndarray
        ψ′(e).
    """

    pull: FloatArray
    slope: FloatArray


def huber_scores(residual: ArrayLike, spread: float) -> Scores:
    """Return Huber's ψ, the residual cut off at 1.345 `spread`; the residual itself if that is 0.

    Any unit; NaN remains NaN.
    """
    array = np.asarray(residual, dtype=np.float64)
    if not spread > 0:
        return Scores(array, np.ones(array.shape))
    bound = HUBER * spread
    return Scores(np.clip(array, -bound, bound), (np.abs(array) < bound).astype(np.float64))


def biweight_scores(residual: ArrayLike, spread: float) -> Scores:
    """Return Tukey's ψ, 0 beyond 4.685 `spread`; the residual itself if that is 0.

    Any unit; NaN remains NaN.
    """
    array = np.asarray(residual, dtype=np.float64)
    if not spread > 0:
        return Scores(array, np.ones(array.shape))
    square = np.minimum((array / (TUKEY * spread)) ** 2, 1.0)
    weighed = np.where(np.isnan(array), np.nan, array * biweight(array / spread))
    return Scores(weighed, (1.0 - square) * (1.0 - 5.0 * square))


class RobustCovariance(NamedTuple):
    """Covariance (P, P) of an estimate, and the number of independent patches of its residual.

    Parameters
    ----------
    matrix : (P, P) ndarray
        In the squared units of the parameters.
    patches : float
        Number of independent patches.
    """

    matrix: FloatArray
    patches: float


def robust_covariance(
    design: FloatArray, scores: Scores, *, rise: FloatArray | None = None
) -> RobustCovariance:
    """Covariance of a robust least-squares estimate with correlated residuals.

    A robust estimate solves ``Σ ψ(e_i) g_i = 0``. With C the autocovariance of ψ(e) and
    ``H = Σ ψ′(e_i) g_i r_iᵀ`` its covariance is ``H⁻¹ (Σ_ij g_i C(i − j) g_jᵀ) H⁻ᵀ``: correlated
    errors of neighbours are included (the "sandwich" estimate). The loss of P degrees of freedom
    is compensated by n / (n − P), n the independent patches.

    Parameters
    ----------
    design : (P, N, N) ndarray
        Partial derivatives g at each grid point; 0 where nothing was compared.
    scores : Scores
        Scores of residuals (N, N) of uniform standard deviation (metres, or over the points' own
        sigma, as the design is then too); NaN where nothing was compared.
    rise : (P, N, N) ndarray, optional
        r: change of the residual with the estimate, where it is known better than by g, whose own
        noise would count as information; g by default.

    Returns
    -------
    RobustCovariance
        In the units of the estimate squared; infinite where there are no more patches than
        parameters. Source: Huber (1967); docs: derivations §13.
    """
    size = len(design)
    covariance = autocovariance(scores.pull, usable_reach(scores.pull))
    compared = np.isfinite(scores.pull)
    patches = float(np.count_nonzero(compared) / correlated_cells(covariance))
    if patches <= size:
        return RobustCovariance(np.full((size, size), np.inf), patches)
    covariance *= patches / (patches - size)
    slope = np.where(compared, scores.slope, 0.0)
    rise = design if rise is None else rise
    inverse = np.linalg.inv((design * slope).reshape(size, -1) @ rise.reshape(size, -1).T)
    sandwich: FloatArray = inverse @ _smeared(design, covariance) @ inverse.T
    return RobustCovariance((sandwich + sandwich.T) / 2.0, patches)


def _smeared(design: FloatArray, covariance: FloatArray) -> FloatArray:
    """``Σ_ij g_i C(i − j) g_jᵀ`` (P, P) over a grid, by FFT; the spectrum of C is kept positive."""
    reach = covariance.shape[0] // 2
    size = padded_size(design.shape[1:], reach)
    kernel = np.zeros(size)
    index = np.arange(-reach, reach + 1)
    kernel[np.ix_(index, index)] = covariance
    power = np.maximum(fft.rfft2(kernel).real, 0.0)
    spectra = fft.rfft2(design, size).reshape(len(design), -1)
    # Columns of a real transform that also represent their mirror images.
    twice = np.full(power.shape, 2.0)
    twice[:, 0] = 1.0
    if size[1] % 2 == 0:
        twice[:, -1] = 1.0
    weighted = spectra * (power * twice).ravel()
    return (weighted @ spectra.conj().T).real / (size[0] * size[1])
