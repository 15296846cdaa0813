"""Blur of one of two noisy surfaces relative to the other, estimated from half-samples."""

from __future__ import annotations

import numpy as np
from scipy import fft

from spcola.arrays import AnyArray, BoolArray, FloatArray, IntArray

# Rings of wavenumbers, from the third on: what is as long as the grid does not determine the blur.
_RINGS = 40
_FIRST_WAVES = 3.0
# A blur that is not so many of its standard deviations from none is none.
_SIGNIFICANT = 3.0


def relative_blur(
    moving: tuple[FloatArray, FloatArray], fixed: tuple[FloatArray, FloatArray]
) -> tuple[float, float]:
    """Return the square of the Gaussian blur of `fixed` against `moving`, and its sigma, cells².

    Noise looks like sharpness, and blurring takes it off. The power of the ground alone is the
    product of the spectra of two halves of a cloud, whose noises have nothing in common; that of
    the fixed surface over that of the moving one is ``exp(−k² b²)`` at the wavenumber k.

    Parameters
    ----------
    moving, fixed : pairs of (N, N) ndarrays
        Heights, metres, from two halves of each cloud's points, brought to one grid and one
        smoothing; NaN where unknown.

    Returns
    -------
    square, sigma : float
        Negative where the moving surface is the blurred one; NaN where no wavenumber determines it.
    """
    size = fixed[0].shape[0]
    wave = 2.0 * np.pi * np.hypot(fft.fftfreq(size)[:, None], fft.rfftfreq(size)[None])
    ring = np.floor(wave / np.pi * _RINGS).astype(np.int64).ravel()
    first = 2.0 * np.pi * _FIRST_WAVES / size
    seen = (ring < _RINGS) & (wave.ravel() > first)
    own, noisy = zip(*(_powers(pair, ring, seen) for pair in (moving, fixed)), strict=True)
    modes = np.bincount(ring[seen], minlength=_RINGS).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = -np.log(own[1] / own[0])
        spread = sum((all_**2 / power**2 - 1.0) for all_, power in zip(noisy, own, strict=True))
        # The ground's own chance is in both; only what is noise makes the ratio uncertain.
        variance = np.maximum(spread, 1e-6) / modes
    k2 = (np.pi * (np.arange(_RINGS) + 0.5) / _RINGS) ** 2
    known = np.isfinite(ratio) & np.isfinite(variance) & (variance < 1.0)
    if not known.any():
        return float("nan"), float("nan")
    information = float(np.sum(k2[known] ** 2 / variance[known]))
    square = float(np.sum(k2[known] * ratio[known] / variance[known])) / information
    scatter = np.sum((ratio[known] - square * k2[known]) ** 2 / variance[known])
    return square, float(np.sqrt(max(scatter / max(known.sum() - 1, 1), 1.0) / information))


def significant_blur(square: float, sigma: float) -> float:
    """Return the blur in cells, with its sign; 0 where it may be none.

    Parameters
    ----------
    square : float
        Squared blur, cells²; negative where the moving cloud is the blurred one.
    sigma : float
        Its standard deviation, cells².
    """
    if not abs(square) > _SIGNIFICANT * sigma:
        return 0.0
    return float(np.sign(square) * np.sqrt(abs(square)))


def _powers(
    halves: tuple[FloatArray, FloatArray], ring: IntArray, seen: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Power by ring of what two halves have in common, and of one of them with its noise."""
    one, two = (_spectrum(half) for half in halves)
    common = np.sum((one * np.conj(two)).real, axis=0).ravel()[seen]
    whole = 0.5 * np.sum(np.abs(one) ** 2 + np.abs(two) ** 2, axis=0).ravel()[seen]
    own: FloatArray = np.bincount(ring[seen], common, minlength=_RINGS).astype(np.float64)
    noisy: FloatArray = np.bincount(ring[seen], whole, minlength=_RINGS).astype(np.float64)
    return own, noisy


def _spectrum(height: FloatArray) -> AnyArray:
    """Transform (2, N, M) of the slopes of a surface, faded out towards the edges.

    Of slopes, not heights: what is long is so much higher that the window would leave some of it
    where the ground is fine. Gaps are no slope: those of two halves have nothing in common.
    """
    window = np.hanning(len(height) + 2)[1:-1]
    down, along = np.gradient(height)
    slopes = np.stack([down, along])
    slopes = np.nan_to_num(slopes - np.nanmean(slopes, axis=(1, 2), keepdims=True))
    spectrum: AnyArray = fft.rfft2(slopes * np.outer(window, window))
    return spectrum
