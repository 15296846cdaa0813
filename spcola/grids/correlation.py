"""Correlations of gridded surfaces with gaps, by FFT."""

from __future__ import annotations

import numpy as np
from scipy import fft

from spcola.arrays import AnyArray, BoolArray, FloatArray

__all__ = ["autocovariance", "independent_patches", "shift_correlations", "shift_variances"]

# Fewer points do not determine a variance.
_LEAST_POINTS = 30
# Largest lag of a correlation, cells.
_LONGEST_LAG = 20


def shift_variances(
    moving: FloatArray,
    moving_mask: BoolArray,
    fixed: FloatArray,
    fixed_weight: FloatArray,
    *,
    reach: int,
) -> FloatArray:
    """Variance of ``fixed(x) − moving(x − shift)`` for every whole-cell shift up to `reach`.

    Only points known on both surfaces are used, by their weights; the mean difference is removed
    for each shift.

    Parameters
    ----------
    moving, fixed : (N, N) ndarrays
        Heights, metres; any finite value where unknown.
    moving_mask : (N, N) bool ndarray
        Where `moving` is known.
    fixed_weight : (N, N) ndarray
        From 0, where `fixed` is not known, to 1.
    reach : int
        Largest shift, cells.

    Returns
    -------
    (2·reach + 1, 2·reach + 1) ndarray
        Index ``[dy + reach, dx + reach]``; square metres; NaN where the summed weight of common
        points is below 30.
    """
    base = float(np.mean(fixed[fixed_weight > 0]))
    a, b = moving - base, fixed - base
    size = padded_size(fixed.shape, reach)
    one, first, second = _spectra(a, moving_mask, size).conj()
    two, third, fourth = _spectra(b, fixed_weight, size)
    square = one * fourth + second * two - 2.0 * first * third
    sums = np.stack([one * two, one * third - first * two, square])
    total, mean, square = _lags(sums, size, reach)
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = square / total - (mean / total) ** 2
    # Half a point for the rounding of the transforms.
    variance[total < _LEAST_POINTS - 0.5] = np.nan
    return np.maximum(variance, 0.0)


def shift_correlations(
    moving: FloatArray,
    moving_mask: BoolArray,
    fixed: FloatArray,
    fixed_mask: BoolArray,
    *,
    reach: int,
) -> FloatArray:
    """Correlation of ``fixed(x)`` with ``moving(x − shift)`` for every whole-cell shift.

    Parameters
    ----------
    moving, fixed : (N, N) ndarrays
        Of any unit, with means near 0; any finite value where unknown.
    moving_mask, fixed_mask : (N, N) bool ndarrays
        Where they are known.
    reach : int
        Largest shift, cells.

    Returns
    -------
    (2·reach + 1, 2·reach + 1) ndarray
        Index ``[dy + reach, dx + reach]``, −1 … 1; NaN where fewer than 30 points overlap, or one
        side has no texture there.
    """
    size = padded_size(fixed.shape, reach)
    one = _spectra(moving, moving_mask, size).conj()
    two = _spectra(fixed, fixed_mask, size)
    total = _lags(one[0] * two[0], size, reach)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_a = _lags(one[1] * two[0], size, reach) / total
        mean_b = _lags(one[0] * two[1], size, reach) / total
        cross = _lags(one[1] * two[1], size, reach) / total - mean_a * mean_b
        spread_a = _lags(one[2] * two[0], size, reach) / total - mean_a**2
        spread_b = _lags(one[0] * two[2], size, reach) / total - mean_b**2
        correlation: FloatArray = cross / np.sqrt(spread_a * spread_b)
    correlation[(total < _LEAST_POINTS - 0.5) | ~np.isfinite(correlation)] = np.nan
    return correlation


def padded_size(shape: tuple[int, ...], reach: int) -> tuple[int, int]:
    """Size of a transform in which lags up to `reach` do not wrap around."""
    rows, columns = (fft.next_fast_len(n + reach, real=True) for n in shape)
    return rows, columns


def _spectra(values: FloatArray, weight: AnyArray, size: tuple[int, int]) -> AnyArray:
    """Transforms (3, …) of weights, of weighted values, and of weighted squares of values."""
    first = values * weight
    return fft.rfft2(np.stack([weight, first, values * first]), size)


def _lags(spectra: AnyArray, size: tuple[int, int], reach: int) -> FloatArray:
    """Lags −reach … reach on the last two axes of correlations given by their spectra (…)."""
    full = fft.irfft2(spectra, size)
    index = np.arange(-reach, reach + 1)
    return full[..., index[:, None], index]


def autocovariance(residual: FloatArray, reach: int) -> FloatArray:
    """Autocovariance of a residual field with gaps, for lags up to `reach` cells.

    Parameters
    ----------
    residual : (N, N) ndarray
        Metres; NaN where there is none.
    reach : int
        Largest lag, cells.

    Returns
    -------
    (2·reach + 1, 2·reach + 1) ndarray
        Square metres. Symmetric; the centre is the variance. A Hann window tapers it to 0 at the
        edge and hardly changes the short lags.
    """
    known = np.isfinite(residual)
    size = padded_size(residual.shape, reach)
    spectra = fft.rfft2(np.stack([known, np.where(known, residual, 0.0)]), size)
    count, product = _lags(spectra.real**2 + spectra.imag**2, size, reach)
    raw = product / np.maximum(count, 1.0)
    taper = 0.5 + 0.5 * np.cos(np.pi * np.arange(-reach, reach + 1) / (reach + 1.0))
    return raw * np.outer(taper, taper)


def independent_patches(residual: FloatArray) -> float:
    """Number of patches of a `residual` field (N, N) whose errors are about independent.

    The number of known points over the area, in cells, that the autocorrelation covers.
    """
    covariance = autocovariance(residual, usable_reach(residual))
    return float(np.count_nonzero(np.isfinite(residual))) / correlated_cells(covariance)


def correlated_cells(covariance: FloatArray) -> float:
    """Area of the correlation, cells, at least one."""
    variance = float(covariance[covariance.shape[0] // 2, covariance.shape[1] // 2])
    return max(float(np.sum(covariance)) / variance, 1.0) if variance > 0 else 1.0


def usable_reach(residual: FloatArray) -> int:
    """Largest lag, cells, of a field's correlation: at most a quarter of the field."""
    return max(1, min(_LONGEST_LAG, residual.shape[0] // 4))
