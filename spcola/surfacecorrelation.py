"""Correlations of gridded surfaces with gaps, by FFT."""

from __future__ import annotations

import numpy as np
from scipy import fft

from spcola.arrays import BoolArray, FloatArray

# Fewer points tell no variance.
_LEAST_POINTS = 30


def shift_variances(
    moving: FloatArray,
    moving_mask: BoolArray,
    fixed: FloatArray,
    fixed_weight: FloatArray,
    *,
    reach: int,
) -> FloatArray:
    """Variance of ``fixed(x) − moving(x − shift)`` for every whole-cell shift up to `reach`.

    Only points that both surfaces hold count, by their weights; the mean difference is removed for
    each shift.

    Parameters
    ----------
    moving, fixed : (N, N) ndarrays
        Heights, metres; any finite value where they are not known.
    moving_mask : (N, N) bool ndarray
        Where `moving` is known.
    fixed_weight : (N, N) ndarray
        From 0, where `fixed` is not known, to 1.
    reach : int
        Largest shift, cells.

    Returns
    -------
    (2·reach + 1, 2·reach + 1) ndarray
        Index ``[dy + reach, dx + reach]``; square metres; NaN where points of less than 30
        in weight meet.
    """
    base = float(np.mean(fixed[fixed_weight > 0]))
    one, two = moving_mask.astype(np.float64), fixed_weight
    a, b = (moving - base) * one, fixed - base
    total = _correlate(one, two, reach)
    cross = _correlate(a, two * b, reach)
    first = _correlate(one, two * b, reach) - _correlate(a, two, reach)
    second = _correlate(one, two * b * b, reach) + _correlate(a * a, two, reach) - 2.0 * cross
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = second / total - (first / total) ** 2
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
        Of any unit, with means near 0; any finite value where they are not known.
    moving_mask, fixed_mask : (N, N) bool ndarrays
        Where they are known.
    reach : int
        Largest shift, cells.

    Returns
    -------
    (2·reach + 1, 2·reach + 1) ndarray
        Index ``[dy + reach, dx + reach]``, −1 … 1; NaN where fewer than 30 points meet, or one
        side has no texture there.
    """
    one, two = moving_mask.astype(np.float64), fixed_mask.astype(np.float64)
    a, b = moving * one, fixed * two
    total = _correlate(one, two, reach)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_a, mean_b = _correlate(a, two, reach) / total, _correlate(one, b, reach) / total
        cross = _correlate(a, b, reach) / total - mean_a * mean_b
        spread_a = _correlate(a * a, two, reach) / total - mean_a**2
        spread_b = _correlate(one, b * b, reach) / total - mean_b**2
        correlation: FloatArray = cross / np.sqrt(spread_a * spread_b)
    correlation[(total < _LEAST_POINTS - 0.5) | ~np.isfinite(correlation)] = np.nan
    return correlation


def _correlate(a: FloatArray, b: FloatArray, reach: int) -> FloatArray:
    """``Σ_x a(x − shift) b(x)`` for shifts −reach … reach on both axes."""
    size = tuple(fft.next_fast_len(n + reach, real=True) for n in a.shape)
    spectrum = np.conj(fft.rfft2(a, size)) * fft.rfft2(b, size)
    full = fft.irfft2(spectrum, size)
    index = np.arange(-reach, reach + 1)
    return full[np.ix_(index, index)]


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
        Square metres. Symmetric; the centre is the variance. A Bartlett window takes it to 0 at
        the edge, which keeps it positive definite.
    """
    known = np.isfinite(residual)
    values = np.where(known, residual, 0.0)
    mask = known.astype(np.float64)
    count = np.maximum(_correlate(mask, mask, reach), 1.0)
    raw = _correlate(values, values, reach) / count
    taper = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1.0)
    return raw * np.outer(taper, taper)


def independent_patches(residual: FloatArray, *, reach: int = 20) -> float:
    """Number of patches of a residual field whose errors are about independent.

    The number of known points over the area, in cells, that the autocorrelation covers.

    Parameters
    ----------
    residual : (N, N) ndarray
        NaN where there is none.
    reach : int
        Largest lag, cells; at most a quarter of the grid is used.
    """
    covariance = autocovariance(residual, _usable(reach, residual))
    variance = float(covariance[covariance.shape[0] // 2, covariance.shape[1] // 2])
    if variance <= 0:
        return float(np.count_nonzero(np.isfinite(residual)))
    area = max(float(np.sum(covariance)) / variance, 1.0)
    return float(np.count_nonzero(np.isfinite(residual))) / area


def _usable(reach: int, residual: FloatArray) -> int:
    """Largest lag that a field can tell about."""
    return max(1, min(reach, residual.shape[0] // 4))


def residual_covariance(
    design: FloatArray, weight: FloatArray, residual: FloatArray, *, reach: int = 20
) -> FloatArray:
    """Covariance of a weighted least-squares estimate under the errors that the residual shows.

    ``H⁻¹ (Σ_ij g_i w_i C(i − j) w_j g_jᵀ) H⁻¹`` with C the autocovariance of the residuals: errors
    that neighbours share count as shared (the "sandwich" estimate). What P parameters have
    taken out of the residuals is put back by n / (n − P), n the independent patches.

    Parameters
    ----------
    design : (N, N, P) ndarray
        Partial derivatives g at each grid point.
    weight : (N, N) ndarray
        0 where nothing was compared.
    residual : (N, N) ndarray
        Of one standard deviation throughout (metres, or over the points' own sigma, as the design
        is then too); NaN where nothing was compared.
    reach : int
        Largest lag, cells; at most a quarter of the grid is used.

    Returns
    -------
    (P, P) ndarray
        In the units of the estimate squared; infinite where there are no more patches than
        parameters. Source: Huber (1967); docs: mathematics §13.
    """
    reach = _usable(reach, residual)
    covariance = autocovariance(residual, reach)
    patches = independent_patches(residual, reach=reach)
    freedom = patches - design.shape[2]
    fields = np.moveaxis(design * weight[..., None], -1, 0)
    information = np.einsum("prc,rcq->pq", fields, design)
    if freedom <= 0:
        return np.full((design.shape[2],) * 2, np.inf)
    size = tuple(fft.next_fast_len(n + 2 * reach, real=True) for n in residual.shape)
    kernel = np.zeros(size)
    index = np.arange(-reach, reach + 1)
    kernel[np.ix_(index, index)] = covariance * patches / freedom
    spread = fft.irfft2(fft.rfft2(fields, size) * fft.rfft2(kernel), size)
    smeared = spread[:, : residual.shape[0], : residual.shape[1]]
    middle = np.einsum("prc,qrc->pq", fields, smeared)
    inverse = np.linalg.inv(information)
    sandwich: FloatArray = inverse @ (middle + middle.T) @ inverse / 2.0
    return sandwich
