"""Echoes of the shots at a body: distances, noise, losses, flags, strengths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidar.truth.settings import (
    MISSING,
    NO_ECHO_RANGE,
    NO_RETURN,
    OVERFLOW,
    VALID,
    LidarSettings,
    ScanErrors,
)
from lidar.truth.shots import Shots
from spcola.arrays import FloatArray, IntArray
from spcola.truth.body import TruthBody

# Columns of the shots' deviates, after those of the place.
_FATE, _RANGE, _OUTLIER, _STRENGTH = 2, 3, 4, 5
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
# Largest tangent of the incidence: beyond, the footprint would exceed its illuminated ground.
_MOST_TANGENT = np.tan(np.radians(80.0))
# Echo of a face at normal incidence, of mean albedo, 1 km away, DN.
_STRENGTH_DN = 2000.0
_STRENGTH_DISTANCE = 1000.0
# Even share of the scattering: dark ground is hardly fainter where it is steep, along the light.
_LAMBERT = 0.35


class Ground(NamedTuple):
    """Intersections of the beams with the ground; NaN where a beam misses.

    Attributes
    ----------
    distance : (N,) ndarray
        Along the beam, mean over the footprint, metres.
    cosine : (N,) ndarray
        Cosine of the incidence.
    points : (N, 3) ndarray
        First hits of the beams' axes, metres.
    """

    distance: FloatArray
    cosine: FloatArray
    points: FloatArray


def meet(body: TruthBody, shots: Shots, settings: LidarSettings) -> Ground:
    """Return the intersections of the beams of `shots` with the body."""
    hits = body.first_hits(shots.spacecraft, shots.beam)
    cosine = -np.einsum("ij,ij->i", hits.normals, shots.beam)
    distance = hits.distance
    if settings.subrays > 1:
        # Where the axis misses, the incidence is unknown: part of a footprint is no echo then.
        footprint = _footprint_distance(body, shots, settings)
        distance = np.where(np.isfinite(distance), footprint, np.nan)
    return Ground(distance, np.clip(cosine, 0.0, 1.0), hits.points)


def _footprint_distance(body: TruthBody, shots: Shots, settings: LidarSettings) -> FloatArray:
    """Return the mean distances (N,) over the beams' footprints; NaN if half of one misses."""
    spread = settings.divergence / 4.0
    first = np.cross(shots.beam, shots.across)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(shots.beam, first)
    total, seen = np.zeros(len(shots)), np.zeros(len(shots))
    for a, b in spread * gaussian_pattern(settings.subrays):
        beam = shots.beam + a * first + b * second
        points = body.cast(shots.spacecraft, beam)
        distance = np.linalg.norm(points - shots.spacecraft, axis=1)
        total += np.nan_to_num(distance)
        seen += np.isfinite(distance)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.asarray(total / seen)
    return np.where(2 * seen > settings.subrays, mean, np.nan)


def gaussian_pattern(count: int) -> FloatArray:
    """Return points (count, 2) spread as a normal distribution of unit variance in each axis."""
    share = (np.arange(count) + 0.5) / count
    radius = np.sqrt(-2.0 * np.log1p(-share))
    angle = _GOLDEN_ANGLE * np.arange(count)
    pattern = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pattern -= pattern.mean(axis=0)
    return pattern / np.sqrt(np.mean(pattern**2))


def flags(shots: Shots, ground: Ground, settings: LidarSettings) -> IntArray:
    """Return the flag (N,) of each shot.

    Echoes are lost with `dropout_share` everywhere, and by a smooth step of the cosine from none
    at `grazing_deg` to all at 90°.
    """
    fate = shots.deviates[:, _FATE]
    edge = np.cos(np.radians(settings.grazing_deg))
    fall = np.clip(1.0 - ground.cosine / edge, 0.0, 1.0)
    steep = fall * fall * (3.0 - 2.0 * fall)
    overflow = settings.overflow_share
    missing = overflow + settings.missing_share
    lost = missing + settings.dropout_share
    lost = lost + (1.0 - lost - settings.stray_share) * steep
    flag = np.full(len(shots), VALID)
    # Comparisons with NaN are false: misses are treated separately.
    flag[~(fate >= lost) | ~np.isfinite(ground.distance)] = NO_RETURN
    flag[fate < missing] = MISSING
    flag[(fate < overflow) & np.isfinite(ground.distance)] = OVERFLOW
    return flag


def stated_range(
    shots: Shots, ground: Ground, settings: LidarSettings, errors: ScanErrors, flag: IntArray
) -> FloatArray:
    """Return the ranges (N,) in a table, metres; the sentinel where there is no echo."""
    footprint = settings.divergence / 4.0 * ground.distance
    cosine = np.maximum(ground.cosine, 1e-6)
    tangent = np.minimum(np.sqrt(1.0 - cosine**2) / cosine, _MOST_TANGENT)
    sigma = np.hypot(settings.range_sigma, settings.slope_noise * footprint * tangent)
    measured = ground.distance * (1.0 + errors.range_scale) + errors.range_bias_m
    measured += sigma * shots.normal(_RANGE) - settings.reference_offset
    outlier = shots.deviates[:, _FATE] >= 1.0 - settings.stray_share
    away = settings.stray_reach * (2.0 * shots.deviates[:, _OUTLIER] - 1.0)
    measured += np.where(outlier, away, 0.0)
    echo = (flag == VALID) | (flag == OVERFLOW)
    return np.where(echo, measured, NO_ECHO_RANGE)


def strengths(
    body: TruthBody, shots: Shots, ground: Ground, settings: LidarSettings, flag: IntArray
) -> FloatArray:
    """Return the strengths (N,) of the echoes, DN; 0 without one.

    The albedo times the scattering of the incidence (partly Lambert, partly even), over the
    square of the distance, with noise.
    """
    echo = (flag == VALID) | (flag == OVERFLOW)
    strength = np.zeros(len(shots))
    strength[echo] = body.albedo(ground.points[echo]) if echo.any() else 0.0
    scattered = 1.0 - _LAMBERT + _LAMBERT * ground.cosine[echo]
    nearness = (_STRENGTH_DISTANCE / np.maximum(ground.distance[echo], 1.0)) ** 2
    noise = 1.0 + settings.intensity_noise * shots.normal(_STRENGTH)[echo]
    strength[echo] *= _STRENGTH_DN * scattered * nearness * np.maximum(noise, 0.0)
    return strength
