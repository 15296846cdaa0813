"""Transfer function of SPC relief relative to lidar relief, by wavelength."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy import fft

from spcola.arrays import FloatArray
from spcola.grids.gaps import bridged, trend_of

_RINGS = 25
# Spectra of surfaces with a larger share of gaps are dominated by the gaps.
_MOST_MISSING = 0.1


@dataclass(frozen=True, eq=False)
class Transfer:
    """Gain and coherence of two surfaces of the same ground at each wavelength.

    Attributes
    ----------
    wavenumber : (K,) ndarray
        Cycles per cell, increasing.
    gain : (K,) ndarray
        Share of the first surface's relief in the second: Re Σ S₁₂ / Σ S₁₁. Noise of the second
        surface does not bias it, as it is not coherent with the first.
    coherence : (K,) ndarray
        ``|Σ S₁₂|² / (Σ S₁₁ Σ S₂₂)``: where it is small the gain is unreliable.
    """

    wavenumber: FloatArray
    gain: FloatArray
    coherence: FloatArray

    def as_json(self) -> dict[str, list[float]]:
        """Return the three arrays as lists, for JSON."""
        return {
            "wavenumber_per_cell": self.wavenumber.tolist(),
            "gain": self.gain.tolist(),
            "coherence": self.coherence.tolist(),
        }


def estimate_transfer(pairs: Iterable[tuple[FloatArray, FloatArray]]) -> Transfer | None:
    """Estimate the common transfer function of many pairs of matched surfaces.

    Parameters
    ----------
    pairs : iterable of two (R, C) ndarrays
        Lidar and SPC heights on one grid, aligned, metres; NaN where unknown. All of one GSD.

    Returns
    -------
    Transfer or None
        None if no pair is nearly whole.
    """
    sums = np.zeros((3, _RINGS), dtype=np.complex128)
    for first, second in pairs:
        known = np.isfinite(first) & np.isfinite(second)
        if known.size and np.mean(~known) < _MOST_MISSING:
            sums += _ring_sums(*(np.where(known, layer, np.nan) for layer in (first, second)))
    own, other, cross = sums[0].real, sums[1].real, sums[2]
    some = (own > 0) & (other > 0)
    if not some.any():
        return None
    wavenumber = 0.5 * (np.arange(_RINGS) + 0.5) / _RINGS
    return Transfer(
        wavenumber[some],
        cross.real[some] / own[some],
        np.abs(cross[some]) ** 2 / (own[some] * other[some]),
    )


def _ring_sums(first: FloatArray, second: FloatArray) -> FloatArray:
    """Sums (3, K) over rings of wavenumber: power of each surface, and their cross-spectrum."""
    taper = np.outer(*(np.hanning(n + 2)[1:-1] for n in first.shape))
    one, two = (fft.fft2(taper * (bridged(layer) - trend_of(layer))) for layer in (first, second))
    rows, columns = (fft.fftfreq(n) for n in first.shape)
    wavenumber = np.hypot(rows[:, None], columns[None, :])
    ring = np.floor(wavenumber * 2 * _RINGS).astype(np.intp).ravel()
    inside = (ring < _RINGS) & (wavenumber.ravel() > 0)
    layers = (np.abs(one) ** 2, np.abs(two) ** 2, one.conj() * two)
    sums: FloatArray = np.array(
        [
            np.bincount(ring[inside], layer.real.ravel()[inside], _RINGS)
            + 1j * np.bincount(ring[inside], layer.imag.ravel()[inside], _RINGS)
            for layer in layers
        ]
    )
    return sums
