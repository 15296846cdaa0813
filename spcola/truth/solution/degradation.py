"""What SPC makes of true heights: softer, shorter, noisy, and adrift where there is no light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.fft import dctn, idctn
from scipy.ndimage import distance_transform_edt, gaussian_filter

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError

# Slopes, against the ground around, between which the surface passes from even to steep.
_STEEP = (0.5, 1.2)
# Cells (1 σ): over which the edge between lit and dark ground is told, and what is left of the
# form of ground in the dark.
_DUSK, _BLURRED = 4.0, 6.0
# Less than this is no darkness to speak of: lit maplets need no drift.
_NO_DEPTH = 1e-3
_MOST_MARGIN = 60.0


@dataclass(frozen=True)
class Softness:
    """How a solution smooths and shortens.

    Parameters
    ----------
    smoothing, steep_smoothing : float
        Gaussian (1 σ, cells) that even ground and steep edges are smoothed by; 0 leaves the
        heights as they are.
    steepest : float
        Slope, against the ground around, that what is steep is flattened towards.
    anchor : float
        Cells over which stereo holds the heights where slopes would take them.
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
    """What a solution does where light is poor.

    Parameters
    ----------
    poor : float
        Share of a rotation: the noise grows where the ground is lit for less.
    noise : float
        Factor of the noise where it is hardly lit at all.
    dark : float
        Share of a rotation: the heights drift and lose their form where it is lit for less.
    drift : float
        Rms of the drift in the dark, metres.
    wavelength : float
        The longest of the drift, cells.
    reach : float
        Cells that heights are carried on from lit ground into such as is never lit; none are
        given further in. Infinite for heights everywhere.
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
        """Cells outside a grid whose light tells on it."""
        return int(np.ceil(max(3.0 * _DUSK, min(self.reach, _MOST_MARGIN) + 1.0)))


class Shade(NamedTuple):
    """What poor light does to heights on a grid (R, C).

    Attributes
    ----------
    noise : ndarray
        Factor of the noise, 1 in good light.
    depth : ndarray
        How far the ground is given over to the dark, 0 … 1.
    lost : ndarray of bool
        Where there are no heights.
    """

    noise: FloatArray
    depth: FloatArray
    lost: BoolArray

    def cropped(self, margin: int) -> Shade:
        """Return what is left without `margin` cells along each edge."""
        inner = (slice(margin, -margin),) * 2
        return Shade(self.noise[inner], self.depth[inner], self.lost[inner])

    def blurred(self, height: FloatArray) -> FloatArray:
        """Return heights (R, C) that lose their form in the dark."""
        if not self.depth.any():
            return height
        soft = gaussian_filter(height, _BLURRED, mode="nearest")
        mixed: FloatArray = height + self.depth * (soft - height)
        return mixed


def shaded(share: FloatArray, darkness: Darkness) -> Shade:
    """Return what light of the given `share` (R, C) of a rotation does to heights.

    Shadows of few cells are bridged from both sides: their depth is that of the dark in the mean
    over some cells. In the dark there is nothing to have noise from; heights drift there instead.
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


def softened(height: FloatArray, gsd: float, softness: Softness) -> FloatArray:
    """Return heights (R, C), metres, smoothed, more so at steep edges, and with boulders short.

    The smoothed surface is left as it is where it is even. Where it is steep against the ground
    around, it is smoothed more, and its slopes are flattened towards `steepest`: such faces lie
    in shadow, or are seen by too few pixels. Heights follow from the slopes as photoclinometry
    integrates them, held to the true ones (which stereo would give) over a distance of `anchor`
    cells, so that not only the faces come out wrong, but the tops too.
    """
    if softness.smoothing == 0.0:
        return height.copy()
    even = gaussian_filter(height, softness.smoothing, mode="nearest")
    soft = gaussian_filter(height, softness.steep_smoothing, mode="nearest")
    ground = gaussian_filter(even, 4.0 * softness.steep_smoothing, mode="nearest")
    low, high = _STEEP
    share = np.clip((_slope(even - ground, gsd) - low) / (high - low), 0.0, 1.0)
    detail = even + share * (soft - even) - ground
    kept = (1.0 + (_slope(detail, gsd) / softness.steepest) ** 4) ** -0.25
    return ground + integrated(detail, kept, softness.anchor)


def _slope(height: FloatArray, gsd: float) -> FloatArray:
    """Return the slope (R, C), as a tangent, of heights (R, C) in metres."""
    rows, columns = np.gradient(height, gsd)
    slope: FloatArray = np.hypot(rows, columns)
    return slope


def integrated(height: FloatArray, kept: FloatArray, anchor: float) -> FloatArray:
    """Return the surface whose steps are those of `height` times `kept` (R, C), least squares.

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
    solved: FloatArray = idctn(
        spectrum / (rows[:, None] + columns[None, :] + 1.0 / anchor**2), norm="ortho"
    )
    return solved


def unresolved(height: FloatArray, softness: Softness) -> FloatArray:
    """Return a local rms (R, C), metres, of what another smoothing would take from `height`.

    A solution can tell this from its own heights: where it is rough or steep, as much again may
    have been lost before.
    """
    if softness.smoothing == 0.0:
        return np.zeros(height.shape)
    taken = height - gaussian_filter(height, softness.steep_smoothing, mode="nearest")
    rms: FloatArray = np.sqrt(gaussian_filter(taken**2, 1.5, mode="nearest"))
    return softness.expected * rms


def _beyond(share: FloatArray, reach: float) -> BoolArray:
    """Return which ground (R, C) is never lit and further than `reach` cells from any that is."""
    if (share > 0.0).all():
        return np.zeros(share.shape, dtype=np.bool_)
    if not (share > 0.0).any():
        return np.full(share.shape, np.isfinite(reach))
    deep: BoolArray = distance_transform_edt(share <= 0.0) > reach
    return deep


def quadratic(height: FloatArray) -> FloatArray:
    """Return the surface of second degree (R, C) next to heights (R, C), by least squares.

    The body's own curvature and the tilt of the ground: what no smoothing should change, and what
    would make it change heights at the edges.
    """
    rows, columns = (
        np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), 3, increasing=True))[0]
        for n in height.shape
    )
    terms = rows.T @ height @ columns
    degree = np.add.outer(np.arange(3), np.arange(3))
    surface: FloatArray = rows @ np.where(degree <= 2, terms, 0.0) @ columns.T
    return surface
