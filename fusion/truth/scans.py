"""The lidar of a synthetic mission, made and written chunk by chunk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from fusion.truth.presets import MissionSettings
from fusion.truth.work import Work, missing
from lidar.truth import (
    SCAN_FORMATS,
    Observation,
    ScanErrors,
    scan_chunks,
    scan_name,
    write_scans,
)
from spcola.navigation import iso_utc
from spcola.truth.campaign import Pass


def plan_observations(passes: Sequence[Pass], settings: MissionSettings) -> dict[str, Observation]:
    """Return the observations of the lidar by file name: rasters, then nadir tracks."""
    tracks = [] if settings.tracks is None else settings.tracks.plan()
    observations: list[Observation] = [*passes, *tracks]
    return {scan_name(at): at for at in observations}


def day_biases(
    observations: Mapping[str, Observation], settings: MissionSettings
) -> dict[str, float]:
    """Return the relative bias of the ranges of each day with observations."""
    days = sorted({iso_utc(at.middle, 0)[:10] for at in observations.values()})
    biases = settings.day_scale_bias or (0.0,)
    return {day: biases[number % len(biases)] for number, day in enumerate(days)}


def write_observations(
    work: Work, observations: Mapping[str, Observation], days: Mapping[str, float]
) -> dict[str, ScanErrors]:
    """Make and write the lidar files; return the planted errors of each, by name.

    Each worker has only a chunk of a scan in memory.
    """

    def make(name: str) -> ScanErrors:
        at = observations[name]
        errors = ScanErrors.drawn(
            work.settings.lidar,
            work.random(f"errors {name}"),
            range_scale=days[iso_utc(at.middle, 0)[:10]],
        )
        if missing(_path(work, name)):
            _write(work, name, at, errors)
        return errors

    found = work.done("lidar scans", make, observations, len(observations))
    return dict(zip(observations, found, strict=True))


def _write(work: Work, name: str, at: Observation, errors: ScanErrors) -> None:
    """Make and write one file, with its own random numbers."""
    lidar, generator = work.settings.lidar, work.random(f"shots {name}")
    chunks = scan_chunks(work.body, at, settings=lidar, errors=errors, generator=generator)
    write_scans(_path(work, name), chunks, format=work.settings.lidar_format)


def _path(work: Work, name: str) -> Path:
    return work.site.lidar / f"{name}{SCAN_FORMATS[work.settings.lidar_format]}"
