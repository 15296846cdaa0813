"""Degradation of true heights by SPC: smoothing, noise, and drift where there is no light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import distance_transform_edt, gaussian_filter

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError

# Slopes, relative to the ground around, between which the surface passes from even to steep.
_STEEP = (0.5, 1.2)
# Cells (1 σ): width of the transition between lit and dark ground, and smoothing of ground in
# the dark.
_DUSK, _BLURRED = 4.0, 6.0
# Smaller depths count as no darkness: lit maplets need no drift.
_NO_DEPTH = 1e-3
_MOST_MARGIN = 60.0


@dataclass(frozen=True)
class Smoothing:
    """Smoothing of heights and reduction of steep relief by a solution.

    Parameters
    ----------
    smoothing, steep_smoothing : float
        Gaussian smoothing (1 σ, cells) of even ground and of steep edges; 0 leaves the heights
        unchanged.
    steepest : float
        Slope, relative to the ground around, to which steep faces are flattened.
    anchor : float
        Distance, cells, over which stereo constrains the heights integrated from slopes.
    expected : float
        The sigma states this many times what one more smoothing takes from the heights.
    """

    smoothing: float = 1.2
    steep_smoothing: float = 2.4
    steepest: float = 0.7
    anchor: float = 8.0
    expected: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.smoothing <= self.steep_smoothing or self.expected < 0:
            raise SettingsError("must be 0 ≤ even ≤ steep, expected ≥ 0", "smoothing")
        if not (self.steepest > 0 and self.anchor > 0):
            raise SettingsError("must be positive", "steepest slope and anchor")


@dataclass(frozen=True)
class Darkness:
    """Errors of a solution where light is poor.

    Parameters
    ----------
    poor : float
        Share of a rotation: the noise grows where the ground is lit for less.
    noise : float
        Factor of the noise where it is hardly lit at all.
    dark : float
        Share of a rotation: heights drift and lose detail where the ground is lit for less.
    drift : float
        Rms of the drift in the dark, metres.
    wavelength : float
        The longest wavelength of the drift, cells.
    reach : float
        Distance, cells, to which heights are extrapolated from lit ground into ground that is
        never lit; there are none further in. Infinite for heights everywhere.
    """

    poor: float = 0.25
    noise: float = 3.0
    dark: float = 0.08
    drift: float = 0.6
    wavelength: float = 60.0
    reach: float = 20.0

    def __post_init__(self) -> None:
        if not 0 < self.dark <= self.poor <= 1:
            raise SettingsError("must be 0 < dark ≤ poor ≤ 1", "shares of light")
        if not (self.noise >= 1 and self.drift >= 0 and self.wavelength > 0 and self.reach >= 0):
            raise SettingsError("noise, drift, wavelength or reach out of range", "darkness")

    @property
    def margin(self) -> int:
        """Cells outside a grid whose light affects it."""
        return int(np.ceil(max(3.0 * _DUSK, min(self.reach, _MOST_MARGIN) + 1.0)))


class Shade(NamedTuple):
    """Effect of poor light on heights on a grid (R, C).

    Attributes
    ----------
    noise : ndarray
        Factor of the noise, 1 in good light.
    depth : ndarray
        Depth of darkness, 0 … 1.
    lost : ndarray of bool
        Where there are no heights.
    """

    noise: FloatArray
    depth: FloatArray
    lost: BoolArray

    def cropped(self, margin: int) -> Shade:
        """Return the shade without `margin` cells along each edge."""
        inner = (slice(margin, -margin),) * 2
        return Shade(self.noise[inner], self.depth[inner], self.lost[inner])

    def blurred(self, height: FloatArray) -> FloatArray:
        """Return heights (R, C) without detail in the dark."""
        if not self.depth.any():
            return height
        soft = gaussian_filter(height, _BLURRED, mode="nearest")
        return height + self.depth * (soft - height)


def shaded(share: FloatArray, darkness: Darkness) -> Shade:
    """Return the effect on heights of light for the given `share` (R, C) of a rotation.

    Shadows of few cells are bridged from both sides: the depth is that of the mean darkness over
    some cells. In the dark there is no noise, since there is no signal; heights drift instead.
    """
    if (share >= darkness.poor).all():
        none = np.zeros(share.shape)
        return Shade(none + 1.0, none, none.astype(np.bool_))
    gone = np.clip(1.0 - share / darkness.dark, 0.0, 1.0)
    depth = gone * gaussian_filter(gone, _DUSK, mode="nearest")
    depth = gaussian_filter(depth, 1.0, mode="nearest")
    depth[depth < _NO_DEPTH] = 0.0
    poor = (1.0 - depth) * np.clip(1.0 - share / darkness.poor, 0.0, 1.0)
    return Shade(1.0 + (darkness.noise - 1.0) * poor, depth, _beyond(share, darkness.reach))


def smoothed(height: FloatArray, gsd: float, smoothing: Smoothing) -> FloatArray:
    """Return heights (R, C), metres, smoothed, more so at steep edges, and with boulders too low.

    The smoothed surface is unchanged where it is even. Where it is steep relative to the ground
    around, it is smoothed more, and its slopes are flattened towards `steepest`: such faces lie
    in shadow, or cover too few pixels. Heights are integrated from the slopes as in
    photoclinometry, constrained to the true ones (which stereo would give) over a distance of
    `anchor` cells, so that the tops are wrong too, not only the faces.
    """
    if smoothing.smoothing == 0.0:
        return height.copy()
    even = gaussian_filter(height, smoothing.smoothing, mode="nearest")
    soft = gaussian_filter(height, smoothing.steep_smoothing, mode="nearest")
    ground = gaussian_filter(even, 4.0 * smoothing.steep_smoothing, mode="nearest")
    low, high = _STEEP
    share = np.clip((_slope(even - ground, gsd) - low) / (high - low), 0.0, 1.0)
    detail = even + share * (soft - even) - ground
    kept = (1.0 + (_slope(detail, gsd) / smoothing.steepest) ** 4) ** -0.25
    return ground + integrated(detail, kept, smoothing.anchor)


def _slope(height: FloatArray, gsd: float) -> FloatArray:
    """Return the slope (R, C), as a tangent, of heights (R, C) in metres."""
    rows, columns = np.gradient(height, gsd)
    return np.hypot(rows, columns)


def integrated(height: FloatArray, kept: FloatArray, anchor: float) -> FloatArray:
    """Return the surface with the steps of `height` times `kept` (R, C), by least squares.

    Minimises ``Σ |∇z − kept ∇h|² + Σ (z − h)² / anchor²``, whose normal equations the cosine
    transform solves exactly.
    """
    balance = height / anchor**2
    for axis in (0, 1):
        one, other = (np.moveaxis(part, axis, 0) for part in (height, kept))
        step = 0.5 * (other[1:] + other[:-1]) * np.diff(one, axis=0)
        out = np.moveaxis(balance, axis, 0)
        out[1:] += step
        out[:-1] -= step
    rows, columns = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in height.shape)
    spectrum = dctn(balance, norm="ortho")
    return idctn(spectrum / (rows[:, None] + columns[None, :] + 1.0 / anchor**2), norm="ortho")


def unresolved(height: FloatArray, smoothing: Smoothing) -> FloatArray:
    """Return a local rms (R, C), metres, of the change of `height` by another smoothing.

    A solution can estimate this from its own heights: where it is rough or steep, as much may have
    been lost before.
    """
    if smoothing.smoothing == 0.0:
        return np.zeros(height.shape)
    taken = height - gaussian_filter(height, smoothing.steep_smoothing, mode="nearest")
    rms: FloatArray = np.sqrt(gaussian_filter(taken**2, 1.5, mode="nearest"))
    return smoothing.expected * rms


def _beyond(share: FloatArray, reach: float) -> BoolArray:
    """Return which ground (R, C) is never lit and further than `reach` cells from lit ground."""
    if (share > 0.0).all():
        return np.zeros(share.shape, dtype=np.bool_)
    if not (share > 0.0).any():
        return np.full(share.shape, np.isfinite(reach))
    return distance_transform_edt(share <= 0.0) > reach


def quadratic(height: FloatArray) -> FloatArray:
    """Return the quadratic surface (R, C) fitted to heights (R, C) by least squares.

    It contains the body's curvature and the tilt of the ground, which smoothing should not change,
    and which would cause edge effects.
    """
    rows, columns = (
        np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), 3, increasing=True))[0]
        for n in height.shape
    )
    terms = rows.T @ height @ columns
    degree = np.add.outer(np.arange(3), np.arange(3))
    return rows @ np.where(degree <= 2, terms, 0.0) @ columns.T
