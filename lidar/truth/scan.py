"""Scans of the synthetic body, with the errors and the rejects of a real altimeter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidar.scans import Scan, join
from lidar.truth.echoes import flags, meet, stated_range, strengths
from lidar.truth.settings import DEMODULATOR, LidarSettings, ScanErrors
from lidar.truth.shots import Shots, raster_shots, track_shots, unit
from lidar.truth.track import Track
from spcola.truth.body import TruthBody
from spcola.truth.campaign import Pass

CHUNK = 250_000
"""Default number of shots in memory at once."""


def scan_chunks(
    body: TruthBody,
    at: Pass,
    *,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
    chunk: int = CHUNK,
) -> Iterator[Scan]:
    """Yield every shot of a raster scan as in a table, rejects included.

    A real table contains the shots without echo too (flag 2, sentinel range, a position near the
    spacecraft): write them with :func:`lidar.truth.files.write_scans`, and do not use them
    directly. The scan does not depend on its division into chunks.

    Parameters
    ----------
    body : TruthBody
        Its body-fixed frame is that of the scan.
    at : Pass
        Path of the spacecraft.
    settings : LidarSettings
    errors : ScanErrors
        Errors of the whole scan.
    generator : numpy.random.Generator
        Generator of the noise of single shots.
    chunk : int
        Shots in memory at once.
    """
    on = DEMODULATOR if settings.demodulator and at.number % 2 else 0
    for shots in raster_shots(body, at, settings, generator, chunk):
        yield _scan(scan_name(at), body, shots, settings, errors, on)


def track_chunks(
    body: TruthBody,
    at: Track,
    *,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
    chunk: int = CHUNK,
) -> Iterator[Scan]:
    """Yield every shot of a nadir track as in a table, rejects included.

    Parameters
    ----------
    body : TruthBody
    at : Track
    settings : LidarSettings
        All but the raster is used.
    errors : ScanErrors
        Those of pointing are along and across the track.
    generator : numpy.random.Generator
        Of the noise.
    chunk : int
        Shots yielded at a time.
    """
    on = DEMODULATOR if settings.demodulator and at.number % 2 else 0
    for shots in track_shots(body, at, generator, chunk):
        yield _scan(track_name(at), body, shots, settings, errors, on)


def make_scan(
    body: TruthBody,
    at: Pass,
    *,
    settings: LidarSettings,
    errors: ScanErrors,
    generator: np.random.Generator,
) -> Scan:
    """Return all that :func:`scan_chunks` yields as one scan; for those that fit into memory.

    Parameters
    ----------
    body, at, settings, errors, generator
        As of :func:`scan_chunks`.
    """
    chunks = scan_chunks(body, at, settings=settings, errors=errors, generator=generator)
    return join(scan_name(at), list(chunks))


def scan_name(at: Pass) -> str:
    """Return the name of the scan of the pass `at`."""
    return f"scan{at.number:02d}"


def track_name(at: Track) -> str:
    """Return the name of the table of the track `at`."""
    return f"track{at.number:02d}"


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
