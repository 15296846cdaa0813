"""Resolution: the share of the truth's relief in a model at each wavelength."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray

_LARGEST_WINDOW = 129
_SMALLEST_WINDOW = 16
_ENOUGH_WINDOWS = 4


@dataclass(frozen=True, eq=False)
class Transfer:
    """Transfer and coherence of a model with the truth, by wavelength.

    Attributes
    ----------
    wavelength : (K,) ndarray
        Decreasing, metres.
    transfer : (K,) ndarray
        Re Σ S_mt / Σ S_tt: the share of the truth's amplitude in the model, in phase.
    coherence : (K,) ndarray
        ``|Σ S_mt|² / (Σ S_mm Σ S_tt)``: 1 if the model is the truth times a factor, 0 if unrelated.
    power_ratio : (K,) ndarray
        Σ S_mm / Σ S_tt, which includes the model's noise.
    windows : int
        Number of windows averaged.
    half_power, half_coherence : float
        Wavelength, metres, below which the model contains less than half of the truth's power
        (transfer² < ½), and below which coherence is less than ½; NaN if there is none.
    reason : str
        Why `half_power` is not known; else empty.
    """

    wavelength: FloatArray
    transfer: FloatArray
    coherence: FloatArray
    power_ratio: FloatArray
    windows: int
    half_power: float
    half_coherence: float
    reason: str = ""


class Spectra:
    """Sums of spectra and cross-spectra of model and truth over windows of grids of one GSD.

    The Laplacian of the heights in a window removes their plane and flattens the steep spectrum of
    relief, so that long waves do not leak into short ones; it cancels in every ratio. Then come a
    Hann window in both directions and the Fourier transform, and sums over rings of equal
    wavenumber. Noise that is uncorrelated with the truth cancels in the cross-spectrum. The truth
    is sampled at the grid points: its wavelengths below two GSD are aliased.

    Windows of a quarter, a half and the whole of the grid are summed; the largest size of which
    enough windows have no gaps is used.

    Parameters
    ----------
    size : int
        Points along a side of the grids.
    gsd : float
        Metres.
    """

    def __init__(self, size: int, gsd: float) -> None:
        sizes = {min(size, _LARGEST_WINDOW) // part for part in (1, 2, 4)}
        self._sums = [_WindowSums(s, gsd) for s in sorted(sizes) if s >= _SMALLEST_WINDOW]

    def add(self, model: FloatArray, truth: FloatArray) -> None:
        """Add heights (R, C) of both on one grid, metres; NaN where unknown."""
        for sums in self._sums:
            sums.add(model, truth)

    @property
    def windows(self) -> int:
        """Number of windows summed of the size that is used."""
        chosen = self._chosen()
        return 0 if chosen is None else chosen.windows

    def transfer(self) -> Transfer:
        """Return the transfer over the windows of the size that is used."""
        chosen = self._chosen()
        if chosen is None:
            nothing, nan = np.empty(0), float("nan")
            why = "no window is without a gap"
            return Transfer(nothing, nothing, nothing, nothing, 0, nan, nan, why)
        return chosen.transfer()

    def _chosen(self) -> _WindowSums | None:
        """Return the largest size with enough windows, else that with the most windows."""
        enough = [sums for sums in self._sums if sums.windows >= _ENOUGH_WINDOWS]
        most = max(self._sums, key=lambda sums: sums.windows, default=None)
        return enough[-1] if enough else most if most is not None and most.windows else None


class _WindowSums:
    """Sums over windows of one size."""

    def __init__(self, size: int, gsd: float) -> None:
        self.size, self.gsd, self.windows = size, gsd, 0
        inner = size - 2  # the Laplacian has no edge
        self.rings = inner // 2
        self.sums = np.zeros((5, self.rings + 1))
        steps = np.fft.fftfreq(inner, 1.0 / inner)
        self._wavenumber = np.hypot(steps[:, None], steps)
        self._ring = np.rint(self._wavenumber).astype(np.int64)
        self._counted = self._ring <= self.rings
        hann = np.hanning(inner + 2)[1:-1]
        self._taper = np.outer(hann, hann)

    def add(self, model: FloatArray, truth: FloatArray) -> None:
        """Add the windows of a grid in which both are known."""
        known = np.isfinite(model) & np.isfinite(truth)
        for cut in _windows(model.shape, self.size):
            if known[cut].all():
                self._add(model[cut], truth[cut])

    def _add(self, model: FloatArray, truth: FloatArray) -> None:
        m, t = (np.fft.fft2(self._taper * _laplacian(height)) for height in (model, truth))
        cross = m * np.conj(t)
        power = np.abs(t) ** 2
        spectra = (np.abs(m) ** 2, power, cross.real, cross.imag, power * self._wavenumber)
        ring, counted = self._ring[self._counted], self._counted
        for number, spectrum in enumerate(spectra):
            self.sums[number] += np.bincount(ring, spectrum[counted], minlength=self.rings + 1)
        self.windows += 1

    def transfer(self) -> Transfer:
        """Return the ratios of the sums."""
        # Rings 0 and 1 lie within the main lobe of the window about the mean.
        model, truth, real, imaginary, moment = self.sums[:, 2:]
        wavelength = (self.size - 2) * self.gsd / np.arange(2, self.rings + 1)
        if not (truth > 0).all():
            empty, nan = np.full(len(wavelength), np.nan), float("nan")
            why = "the truth has no relief"
            return Transfer(wavelength, empty, empty, empty, self.windows, nan, nan, why)
        # The wavenumber of a ring is the mean over the truth's power in it.
        wavelength = (self.size - 2) * self.gsd * truth / moment
        kept = real / truth
        coherence = (real**2 + imaginary**2) / np.maximum(model * truth, 1e-300)
        half, why = _crossing(wavelength, np.where(kept > 0, kept**2, 0.0))
        return Transfer(
            wavelength, kept, coherence, model / truth, self.windows,
            half, _crossing(wavelength, coherence)[0], why,
        )  # fmt: skip


def _windows(shape: tuple[int, ...], size: int) -> Iterable[tuple[slice, slice]]:
    """Yield windows that cover the grid, overlapping where necessary."""
    starts = [
        np.unique(np.linspace(0, length - size, -(-length // size)).astype(int)).tolist()
        for length in shape
    ]
    for row in starts[0]:
        for column in starts[1]:
            yield slice(row, row + size), slice(column, column + size)


def _laplacian(height: FloatArray) -> FloatArray:
    """Return the five-point Laplacian (R−2, C−2), in the heights' unit."""
    inner: FloatArray = (
        height[:-2, 1:-1] + height[2:, 1:-1] + height[1:-1, :-2] + height[1:-1, 2:]
        - 4.0 * height[1:-1, 1:-1]
    )  # fmt: skip
    return inner


def _crossing(wavelength: FloatArray, share: FloatArray) -> tuple[float, str]:
    """Return where `share` first falls below ½ from long wavelengths on, or NaN and why not."""
    below = np.flatnonzero(share < 0.5)
    if not len(below):
        return float("nan"), f"more than half is left down to {wavelength[-1]:.3g} m"
    first = int(below[0])
    if first == 0:
        return float("nan"), f"less than half is left even at {wavelength[0]:.3g} m"
    before, after = share[first - 1], share[first]
    part = (before - 0.5) / (before - after)
    ratio = wavelength[first] / wavelength[first - 1]
    return float(wavelength[first - 1] * ratio**part), ""
