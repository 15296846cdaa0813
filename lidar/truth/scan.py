"""Scans of the synthetic body, with the errors and the rejects of a real altimeter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidar.scans import Scan
from lidar.truth.echoes import flags, meet, stated_range, strengths
from lidar.truth.settings import DEMODULATOR, LidarSettings, ScanErrors
from lidar.truth.shots import Shots, raster_shots, track_shots, unit
from lidar.truth.track import NadirTrack
from spcola.truth.body import TruthBody
from spcola.truth.campaign import Pass

CHUNK = 250_000
"""Default number of shots in memory at once."""

Observation = Pass | NadirTrack
"""What the lidar observes at a time: a raster during a pass of the spacecraft, or a nadir track."""


def scan_chunks(
    body: TruthBody,
    at: Observation,
    *,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
    chunk: int = CHUNK,
) -> Iterator[Scan]:
    """Yield every shot of a raster scan or a nadir track as in a table, rejects included.

    A real table contains the shots without echo too (flag 2, sentinel range, a position near the
    spacecraft): write them with :func:`lidar.truth.files.write_scans`, and do not use them
    directly. The scan does not depend on its division into chunks.

    Parameters
    ----------
    body : TruthBody
        Its body-fixed frame is that of the scan.
    at : Pass or NadirTrack
        Path of the spacecraft.
    settings : LidarSettings
        Those of the raster are not used for a track.
    errors : ScanErrors
        Errors of the whole scan; those of pointing are along and across a track.
    generator : numpy.random.Generator
        Generator of the noise of single shots.
    chunk : int
        Shots in memory at once.
    """
    on = DEMODULATOR if settings.demodulator and at.number % 2 else 0
    if isinstance(at, Pass):
        parts = raster_shots(body, at, settings, generator, chunk)
    else:
        parts = track_shots(body, at, generator, chunk)
    for shots in parts:
        yield _scan(scan_name(at), body, shots, settings, errors, on)


def scan_name(at: Observation) -> str:
    """Return the name of the scan of the pass `at`, or of the table of the track `at`."""
    return f"{'scan' if isinstance(at, Pass) else 'track'}{at.number:02d}"


def _scan(
    name: str,
    body: TruthBody,
    shots: Shots,
    settings: LidarSettings,
    errors: ScanErrors,
    demodulator: int,
) -> Scan:
    """Return the shots of a chunk as in a table."""
    ground = meet(body, shots, settings)
    flag = flags(shots, ground, settings)
    measured = stated_range(shots, ground, settings, errors, flag)
    along, across = errors.pointing_m
    beam = unit(shots.beam + (along * shots.along + across * shots.across) / shots.gap)
    spacecraft = shots.spacecraft + np.array(errors.offset_m)
    return Scan(
        name=name,
        time=shots.time,
        range=measured,
        spacecraft=spacecraft,
        beam=beam,
        points=spacecraft + (measured + settings.reference_offset)[:, None] * beam,
        intensity=strengths(body, shots, ground, settings, flag),
        flag=(flag + demodulator).astype(np.int16),
        # The sigma stated in a table: the level at normal incidence.
        sigma=np.full(len(shots), settings.range_sigma),
    )
