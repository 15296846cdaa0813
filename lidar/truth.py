"""Scans of the synthetic body, with the errors and the rejects of a real altimeter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidar.scan import Scan
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import SettingsError
from spcola.truth.body import TruthBody
from spcola.truth.passes import Pass

NO_ECHO_RANGE = -1.12892
"""Range, metres, that OLA's tables give where no echo came back."""
VALID, NO_RETURN, DEMODULATOR = 0, 2, 100
"""Values of the flag; the hundred is added while the demodulator is on."""


@dataclass(frozen=True)
class LidarSettings:
    """What the scans are like; the error levels are what is published for Bennu.

    Parameters
    ----------
    shots : int
        Of one scan: the next square number is taken.
    width : float
        Of the raster at the body, in mean radii.
    range_sigma : float
        Of a single return, metres (1 σ).
    trajectory_sigma : float
        Of each scan's error of the spacecraft position, for each axis, metres.
    pointing_sigma : float
        Of each scan's error of pointing, on the ground, for each direction, metres.
    stray_share, dropout_share : float
        Of the returns: with a range that has nothing to do with the surface; without echo.
    stray_reach : float
        Strays lie up to this far before and behind the surface, metres.
    reference_offset : float
        Distance from spacecraft to surface less the range as the tables give it, metres.
    """

    shots: int = 62_500
    width: float = 1.4
    range_sigma: float = 0.03
    trajectory_sigma: float = 0.05
    pointing_sigma: float = 0.05
    stray_share: float = 0.005
    dropout_share: float = 0.01
    stray_reach: float = 30.0
    reference_offset: float = 1.1

    def __post_init__(self) -> None:
        if self.shots < 4 or self.width <= 0:
            raise SettingsError("needs shots and a width", "scans")
        if min(self.range_sigma, self.trajectory_sigma, self.pointing_sigma) < 0:
            raise SettingsError("must not be negative", "error levels of the scans")
        if not 0 <= self.stray_share + self.dropout_share < 1:
            raise SettingsError("shares of strays and drop-outs must stay below 1", "scans")


@dataclass(frozen=True)
class ScanErrors:
    """What is wrong with a whole scan.

    Attributes
    ----------
    offset_m : tuple of 3 float
        Stated minus true position of the spacecraft, body-fixed.
    pointing_m : tuple of 2 float
        Error of pointing on the ground, along and across the raster's lines.
    range_scale : float
        Stated ranges are true ones times 1 + this (the bias of a day).
    """

    offset_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    pointing_m: tuple[float, ...] = (0.0, 0.0)
    range_scale: float = 0.0


def draw_errors(
    settings: LidarSettings, generator: np.random.Generator, *, range_scale: float = 0.0
) -> ScanErrors:
    """Draw the errors of one scan."""
    offset = settings.trajectory_sigma * generator.normal(size=3)
    pointing = settings.pointing_sigma * generator.normal(size=2)
    return ScanErrors(tuple(offset.tolist()), tuple(pointing.tolist()), range_scale)


def make_scan(
    body: TruthBody,
    at: Pass,
    *,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
) -> Scan:
    """Return every shot of a raster scan as a table states it, rejects included.

    A real table holds the shots without echo too (flag 2, sentinel range, a position beside the
    spacecraft): to be written with :func:`lidar.formats.ola.write_ola`, not to be used as it is.

    Parameters
    ----------
    body : TruthBody
        Its body-fixed frame is that of the scan.
    at : Pass
        Where the spacecraft is.
    settings : LidarSettings
    errors : ScanErrors
        What is wrong with the whole scan.
    generator : numpy.random.Generator
        Of the noise of single shots.
    """
    time, spacecraft, aim, sides = _raster(body, at, settings, generator)
    beam = _normalised(aim - spacecraft)
    distance = np.linalg.norm(body.cast(spacecraft, beam) - spacecraft, axis=1)
    echo, measured = _measured(distance, settings, errors, generator)
    stated_position = spacecraft + np.array(errors.offset_m)
    turn = (errors.pointing_m[0] * sides[0] + errors.pointing_m[1] * sides[1]) / at.distance
    stated_beam = _normalised(beam + turn)
    reach = measured + settings.reference_offset
    demodulator = DEMODULATOR if at.number % 2 else 0
    return Scan(
        name=scan_name(at),
        time=time,
        range=measured,
        spacecraft=stated_position,
        beam=stated_beam,
        points=stated_position + reach[:, None] * stated_beam,
        intensity=np.where(echo, _intensity(body, spacecraft, beam, distance), 0.0),
        flag=(np.where(echo, VALID, NO_RETURN) + demodulator).astype(np.int16),
        sigma=np.full(len(time), settings.range_sigma),
    )


def scan_name(at: Pass) -> str:
    """Return the name of the scan of a pass."""
    return f"scan{at.number:02d}"


def _raster(
    body: TruthBody, at: Pass, settings: LidarSettings, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return times (N,), positions (N, 3), points aimed at (N, 3), and the raster's sides (2, 3).

    Lines are swept to and fro; each shot falls somewhere in its own square of the raster, so
    that no grid can resonate with it.
    """
    lines = int(np.ceil(np.sqrt(settings.shots)))
    toward = at.position(np.array([at.middle]))[0] / at.distance
    along = np.cross([0.0, 0.0, 1.0], toward)
    along /= np.linalg.norm(along)
    sides = np.stack([along, np.cross(toward, along)])
    steps = np.arange(lines, dtype=np.float64)
    v, u = np.meshgrid(steps, steps, indexing="ij")
    u[1::2] = u[1::2, ::-1].copy()
    place = np.stack([u.ravel(), v.ravel()], axis=1) + generator.random((lines**2, 2))
    width = settings.width * body.settings.radius
    aim = (place / lines - 0.5) * width @ sides
    time = at.start + at.duration * (np.arange(lines**2) + 0.5) / lines**2
    return time, at.position(time), aim, sides


def _measured(
    distance: FloatArray,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
) -> tuple[BoolArray, FloatArray]:
    """Return which shots have an echo (N,), and the ranges (N,) that the table states, metres."""
    count = len(distance)
    measured = distance * (1.0 + errors.range_scale) - settings.reference_offset
    measured += settings.range_sigma * generator.normal(size=count)
    fate = generator.random(count)
    stray = fate < settings.stray_share
    measured += np.where(stray, settings.stray_reach * generator.uniform(-1, 1, size=count), 0.0)
    lost = (fate >= settings.stray_share) & (fate < settings.stray_share + settings.dropout_share)
    echo = np.isfinite(distance) & ~lost
    return echo, np.where(echo, measured, NO_ECHO_RANGE)


def _intensity(
    body: TruthBody, spacecraft: FloatArray, beam: FloatArray, distance: FloatArray
) -> FloatArray:
    """Return echo strengths (N,), DN: the albedo, over the square of the range."""
    points = spacecraft + np.nan_to_num(distance)[:, None] * beam
    return 2000.0 * body.albedo(points) * (3500.0 / np.maximum(distance, 1.0)) ** 2


def _normalised(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
