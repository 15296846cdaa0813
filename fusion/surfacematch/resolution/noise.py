"""How the difference of two surfaces is spread over wavelengths, and the filter that evens it out.

Errors of SPC heights hold together over several cells: nearly all of their power lies at long
wavelengths, while the relief that tells a displacement has much of its own at short ones. In a fit
that takes the points as equals the few long waves drown what the many short ones say. Both surfaces
are therefore passed through the filter that makes their difference white: the likelihood of
correlated Gaussian errors is that of white ones after it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from fusion.surfacematch.resolution.resolution import trend_of
from spcola.arrays import (
    BoolArray,
    FloatArray,
    check_finite,
    check_shape,
    frozen,
)
from spcola.errors import InvalidValueError
from spcola.grids import carried_on, closable, closed
from spcola.grids.statistics import autocovariance
from spcola.math.robust import mad

# Below this share of the largest power a residual shows what the model of the surfaces lacks, and
# not noise: the filter trusts no wavelength more than this allows.
_LEAST = 3e-3
# Lags, cells, over which the noise of a residual is looked at, and rings of wavenumber.
_REACH = 24
_RINGS = 37
# Robust standard deviations at which a difference is cut off: a boulder is no noise.
_CUT = 3.0
# Cells by which a field is carried on beyond its edges.
_MARGIN = 12
# Standard deviation, cells, of the neighbourhood of which a filtered point must know this share.
_SUPPORT = 1.5
_KNOWN = 0.9


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Power of the difference of two surfaces by wavenumber, alike in all directions.

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
        """Gain (…) of the whitening filter at wavenumbers (…), cycles per cell; at most 1."""
        least = _LEAST * float(self.power.max())
        at = np.maximum(np.interp(wavenumber, self.wavenumber, self.power), least)
        gain: FloatArray = np.sqrt(least / at)
        return gain

    def as_json(self) -> dict[str, list[float]]:
        """Wavenumber (cycles per cell) and power, as other programs read them."""
        return {
            "wavenumber_per_cell": self.wavenumber.tolist(),
            "power": self.power.tolist(),
        }

    @property
    def level(self) -> float:
        """Gain for a plane: a symmetric filter leaves it a plane."""
        return float(self.gain(np.zeros(1))[0])

    def whitened(self, height: FloatArray) -> FloatArray:
        """Pass heights (…, R, C), metres, without gaps (:func:`bridged`) through the filter.

        A symmetric filter leaves a paraboloid what it is, times its gain for a plane, but for a
        constant: that of the surface is taken out before and put back after. What is left goes on
        beyond the edges as its point reflection does. A surface that is mirrored there has a kink
        in its slope; filtered, the kinks of both surfaces are alike and lie where the grid ends,
        whatever the displacement, and draw it to 0. :func:`supported` shows which points are as
        good as without edges and gaps.
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
    """The spectrum that differences of many matched surfaces have in common.

    Each is divided by its own robust standard deviation and cut off at three of them, so that
    neither dark ground nor boulders speak for the rest.

    Parameters
    ----------
    residuals : iterable of (R, C) ndarrays
        Metres; NaN where nothing was compared. Of one GSD.

    Returns
    -------
    NoiseSpectrum or None
        None if no residual tells a variance.
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
    held = members > 0
    return NoiseSpectrum(mean[0][held], mean[1][held] / mean[1].max())


def bridged(height: FloatArray) -> FloatArray:
    """Heights (R, C), metres, with gaps closed by what is around: smoothly where they are narrow.

    A wide gap, or one that is open to the edge, goes on as the surface's paraboloid does: what is
    level there has a kink that a filter carries far. 0 everywhere if nothing is known.
    """
    known = np.isfinite(height)
    if known.all():
        return height
    if not known.any():
        return np.zeros(height.shape)
    trend = trend_of(height)
    return carried_on(closed(height - trend)) + trend


def supported(known: BoolArray) -> BoolArray:
    """Where (R, C) a filtered value rests on points that are known, beyond a few around it.

    What narrow gaps lack is told by the points around them, as :func:`bridged` closes them.
    """
    share = ndimage.gaussian_filter(closable(known).astype(np.float64), _SUPPORT, mode="constant")
    enough: BoolArray = known & (share > _KNOWN)
    return enough
