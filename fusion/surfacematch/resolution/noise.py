"""Power spectrum of the difference of two surfaces, and the filter that whitens it.

Errors of SPC heights are correlated over several cells: nearly all of their power lies at long
wavelengths, while the relief that determines a displacement has much power at short ones. A fit
with equal weights of all points would be dominated by the long wavelengths. Both surfaces are
therefore passed through the filter that makes their difference white: the likelihood of correlated
Gaussian errors is that of white errors after the filter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from spcola.arrays import BoolArray, FloatArray, check_finite, check_shape, frozen
from spcola.errors import InvalidValueError
from spcola.grids.correlation import autocovariance
from spcola.grids.gaps import closable, trend_of
from spcola.math.robust import mad

# Below this share of the largest power a residual shows deficiencies of the model rather than
# noise: it is the smallest power that the filter assumes.
_LEAST = 3e-3
# Largest lag, cells, of a residual's autocovariance, and number of rings of wavenumber.
_REACH = 24
_RINGS = 37
# Robust standard deviations at which a difference is clipped: a boulder is not noise.
_CUT = 3.0
# Cells by which a field is continued beyond its edges.
_MARGIN = 12
# Standard deviation, cells, of a filtered point's neighbourhood, and the share of it that must be
# known.
_SUPPORT = 1.5
_KNOWN = 0.9


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Isotropic power spectrum of the difference of two surfaces.

    Parameters
    ----------
    wavenumber : (K,) array_like
        Cycles per cell, increasing from 0.
    power : (K,) array_like
        Relative; only the shape matters.

    Raises
    ------
    InvalidValueError
        If lengths disagree, a number is not finite, or no power is positive.
    """

    wavenumber: FloatArray
    power: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavenumber", frozen(self.wavenumber, (None,), "wavenumber"))
        check_shape(np.asarray(self.power), self.wavenumber.shape, "power")
        object.__setattr__(self, "power", frozen(self.power, (None,), "power"))
        check_finite(self.wavenumber, "wavenumber")
        check_finite(self.power, "power")
        if not self.power.max() > 0:
            raise InvalidValueError("is nowhere positive", "power")

    def gain(self, wavenumber: FloatArray) -> FloatArray:
        """Gain (…) of the whitening filter at each `wavenumber` (…), cycles per cell; at most 1."""
        least = _LEAST * float(self.power.max())
        at = np.maximum(np.interp(wavenumber, self.wavenumber, self.power), least)
        gain: FloatArray = np.sqrt(least / at)
        return gain

    def as_json(self) -> dict[str, list[float]]:
        """Return wavenumber (cycles per cell) and power as lists, for JSON."""
        return {
            "wavenumber_per_cell": self.wavenumber.tolist(),
            "power": self.power.tolist(),
        }

    @property
    def level(self) -> float:
        """Gain for a plane: a symmetric filter leaves it a plane."""
        return float(self.gain(np.zeros(1))[0])

    def whitened(self, height: FloatArray) -> FloatArray:
        """Pass `height` (…, R, C), metres, without gaps (:func:`bridged`) through the filter.

        A symmetric filter multiplies a paraboloid by its gain for a plane, except for a constant:
        the surface's paraboloid is subtracted before and added, times that gain, after. The rest is
        continued beyond the edges by point reflection. Mirror reflection would make kinks in the
        slope which, filtered, are the same in both surfaces at the edges of the grid whatever the
        displacement, and bias it towards 0. :func:`supported` gives the points that edges and gaps
        do not affect.
        """
        trend = np.stack([trend_of(layer) for layer in height.reshape(-1, *height.shape[-2:])])
        trend = trend.reshape(height.shape)
        shape = height.shape[-2:]
        size = [fft.next_fast_len(n + 2 * _MARGIN, real=True) for n in shape]
        beyond = [(_MARGIN, n - rest - _MARGIN) for n, rest in zip(size, shape, strict=True)]
        whole = [(0, 0)] * (height.ndim - 2)
        padded = np.pad(height - trend, [*whole, *beyond], mode="reflect", reflect_type="odd")
        rows, columns = fft.fftfreq(size[0]), fft.rfftfreq(size[1])
        gain = self.gain(np.hypot(rows[:, None], columns[None, :]))
        filtered = fft.irfft2(fft.rfft2(padded) * gain, size)
        inner: FloatArray = filtered[
            ..., _MARGIN : _MARGIN + shape[0], _MARGIN : _MARGIN + shape[1]
        ]
        return inner + self.level * trend


def estimate_spectrum(residuals: Iterable[FloatArray]) -> NoiseSpectrum | None:
    """Estimate the common spectrum of the differences of many matched surfaces.

    Each is divided by its robust standard deviation and clipped at three of them, so that neither
    dark ground nor boulders dominate.

    Parameters
    ----------
    residuals : iterable of (R, C) ndarrays
        Metres; NaN where nothing was compared. All of one GSD.

    Returns
    -------
    NoiseSpectrum or None
        None if no residual gives a variance.
    """
    total, count = np.zeros((2 * _REACH + 1,) * 2), 0
    for residual in residuals:
        spread = float(mad(residual))
        if np.isfinite(spread) and spread > 0 and min(residual.shape) > 2 * _REACH:
            total += autocovariance(np.clip(residual / spread, -_CUT, _CUT), _REACH)
            count += 1
    if not count:
        return None
    size = 4 * _REACH
    power = np.abs(fft.rfft2(total / count, (size, size)))
    wavenumber = np.hypot(fft.fftfreq(size)[:, None], fft.rfftfreq(size)[None, :])
    ring = np.minimum(np.round(wavenumber * 2 * (_RINGS - 1)), _RINGS - 1).astype(np.intp).ravel()
    members = np.bincount(ring, minlength=_RINGS)
    mean = [
        np.bincount(ring, weights=layer.ravel(), minlength=_RINGS) / np.maximum(members, 1)
        for layer in (wavenumber, power)
    ]
    filled = members > 0
    return NoiseSpectrum(mean[0][filled], mean[1][filled] / mean[1].max())


def supported(known: BoolArray) -> BoolArray:
    """Mask (R, C) of known points whose neighbourhood is known but for narrow gaps.

    :func:`spcola.grids.bridged` closes narrow gaps by the points around them.
    """
    share = ndimage.gaussian_filter(closable(known).astype(np.float64), _SUPPORT, mode="constant")
    enough: BoolArray = known & (share > _KNOWN)
    return enough
