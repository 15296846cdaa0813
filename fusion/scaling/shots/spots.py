"""Predicted ranges of shots: mean over the footprint, and variance by pointing and roughness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, check_finite
from spcola.errors import InvalidValueError
from spcola.shape import RayCaster

# Rays around the axis: number of rings of equal area, and of rays on each.
_RINGS, _ON_RING = 3, 6


@dataclass(frozen=True)
class SpotOptions:
    """Assumptions about single shots.

    Parameters
    ----------
    footprint_rad : float
        Full width of the beam, radians; 0: not known, the range is that of the beam's axis.
    pointing_sigma_rad : float
        Standard deviation of the beam's direction, each of two axes, radians; 0: not known.
    range_sigma_m : float
        Of a range, metres, if the scan has none.

    Raises
    ------
    InvalidValueError
        If a number is negative or not finite.
    """

    footprint_rad: float = 0.0
    pointing_sigma_rad: float = 0.0
    range_sigma_m: float = 0.1

    def __post_init__(self) -> None:
        numbers = np.array([self.footprint_rad, self.pointing_sigma_rad, self.range_sigma_m])
        check_finite(numbers, "spots")
        if numbers.min() < 0:
            raise InvalidValueError("must not be negative", "footprint, pointing or range sigma")


@dataclass(frozen=True, eq=False)
class Spots:
    """Predicted ranges of N shots.

    Attributes
    ----------
    distance : (N,) ndarray
        To the surface, mean over the footprint, metres; NaN if the axis misses.
    normal : (N, 3) ndarray
        Outward unit normal where the axis hits the surface.
    variance : (N,) ndarray
        Of the predicted range, by pointing and roughness, m².
    """

    distance: FloatArray
    normal: FloatArray
    variance: FloatArray


def cast_spots(
    caster: RayCaster, spacecraft: FloatArray, beam: FloatArray, options: SpotOptions
) -> Spots:
    """Predict the ranges of shots from `spacecraft` (N, 3), metres, along `beam` (N, 3).

    The range of a footprint is the mean of rays that fill its disc evenly. Their variance about a
    plane is added, as it is not known which part of a rough spot makes the echo. A pointing error
    (δ₁, δ₂) changes the range by r(δ) − r(0); its mean square over rays with the distribution of
    the pointing is added too: (∂r/∂δ)² σ² on a plane, more on rough ground.
    """
    hits = caster.cast(spacecraft, beam)
    distance, variance = hits.distance.copy(), np.zeros(len(beam))
    if options.footprint_rad > 0:
        ring = options.footprint_rad / 2.0 * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
        offsets, inside = _around(caster, spacecraft, beam, ring)
        with np.errstate(invalid="ignore"):
            mean, rough = _mean_and_roughness(offsets, inside)
        distance = np.where(np.isfinite(distance), mean, np.nan)
        variance += np.nan_to_num(rough) ** 2
    if options.pointing_sigma_rad > 0:
        # Quantiles of a two-dimensional normal distribution, scaled to its mean square, 2 σ².
        ring = np.sqrt(-2.0 * np.log(1.0 - (np.arange(_RINGS) + 0.5) / _RINGS))
        ring *= options.pointing_sigma_rad * np.sqrt(2.0 / np.mean(ring**2))
        _, aside = _around(caster, spacecraft, beam, ring)
        off = (aside - hits.distance[:, None]) ** 2
        met = np.isfinite(off)
        variance += np.where(met, off, 0.0).sum(axis=1) / np.maximum(met.sum(axis=1), 1)
    return Spots(distance, hits.normals, variance)


def _around(
    caster: RayCaster, spacecraft: FloatArray, beam: FloatArray, ring: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Ranges (N, K) of rays at angles `ring` from the axis, and their offsets (K, 2), radians."""
    turn = np.arange(_ON_RING) * (2.0 * np.pi / _ON_RING)
    # Rings are rotated against each other, so that their rays have different directions.
    phase = turn[None, :] + np.arange(_RINGS)[:, None] * (np.pi / _ON_RING)
    offsets = (ring[:, None, None] * np.stack([np.cos(phase), np.sin(phase)], axis=2)).reshape(
        -1, 2
    )
    across = np.cross(beam, np.eye(3)[np.argmin(np.abs(beam), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    sides = np.stack([across, np.cross(beam, across)], axis=1)
    rays = beam[:, None, :] + np.einsum("kj,nji->nki", offsets, sides)
    starts = np.broadcast_to(spacecraft[:, None, :], rays.shape)
    found = caster.cast(starts.reshape(-1, 3), rays.reshape(-1, 3))
    return offsets, found.distance.reshape(len(beam), -1)


def _mean_and_roughness(offsets: FloatArray, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (N,) of ranges (N, K), and their rms (N,) about a plane over the `offsets` (K, 2)."""
    mean = np.nanmean(ranges, axis=1)
    rest = np.where(np.isfinite(ranges), ranges - mean[:, None], 0.0)
    unit = offsets / np.linalg.norm(offsets, axis=0)
    rest = rest - (rest @ unit) @ unit.T
    return mean, np.sqrt(np.sum(rest**2, axis=1) / (len(offsets) - 3))
