"""Forecast of the size of a synthetic mission, and of the time to make it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fusion.runtime import usable_cores
from fusion.truth.blind.plan import blind_stations
from fusion.truth.blind.settings import BlindSettings
from fusion.truth.images import FINEST, SURFACE_BYTES
from fusion.truth.presets import MissionSettings
from lidar.truth import scan_size
from spcola.errors import WorkspaceError

# Seconds of one core, as measured on one machine; a rough guide.
_BASE_SECONDS = 10.0
_PER_SHOT, _PER_NODE, _PER_STATE = 8e-6, 7e-6, 0.01
_PER_PIXEL, _PER_IMAGE = 3.3e-6, 0.1
# Rocks down to centimetres make the body slower to evaluate.
_ROCKY = 1.3
# Bytes: heights, albedo and sigma of a node; a vertex of the shape; a state with its landmarks, a
# landmark with its pictures; the header of a file.
_NODE_BYTES, _VERTEX_BYTES, _STATE_BYTES, _LANDMARK_BYTES = 6.0, 40.0, 8_000.0, 6_000.0
_PIXEL_BYTES, _HEAD_BYTES = 2.0, 8_640.0
# Memory of the program itself, of a worker, and of a sample of the surface for images.
# A body that is a mesh: to make a facet, and its memory with the tree of rays.
_PER_FACET, _FACET_MEMORY = 1.0e-5, 420.0
_BASE_MEMORY, _WORKER_MEMORY, _SAMPLE_BYTES = 450e6, 250e6, 4.5
# Some space is to remain on the disk.
_RESERVE = 1.02


@dataclass(frozen=True)
class MissionSize:
    """Forecast of a mission.

    Attributes
    ----------
    radius : float
        Mean radius of the body, metres.
    scans, shots, returns : int
        Lidar files; shots of all of them together, and the expected returns.
    maplets, states, images : int
        Maplets and states of images of the SPC solution; rendered images.
    bytes : float
        On disk.
    seconds : float
        Estimated for the cores that this process may use.
    memory_bytes : float
        Estimated, at most.
    """

    radius: float
    scans: int
    shots: int
    returns: int
    maplets: int
    states: int
    images: int
    bytes: float
    seconds: float
    memory_bytes: float

    def lines(self) -> Iterator[str]:
        """Yield the forecast as lines of text."""
        yield f"a body of {self.radius:,g} m in mean radius"
        yield f"{self.scans} lidar files, {self.returns:,} returns"
        if self.images and not self.maplets:
            yield f"{self.images} raw images"
        if self.maplets:
            yield f"{self.maplets} maplets, {self.states} states, {self.images} rendered images"
        yield f"{_amount(self.bytes)} on disk, up to {_amount(self.memory_bytes)} of memory"
        yield f"about {_duration(self.seconds)} on {usable_cores()} cores"

    def as_dict(self) -> dict[str, Any]:
        """Return all of it in JSON types."""
        return asdict(self)


def mission_size(settings: MissionSettings) -> MissionSize:
    """Return the forecast for a mission of these settings."""
    tracks = [] if settings.tracks is None else settings.tracks.plan()
    raster = scan_size(settings.lidar, settings.lidar_format)
    passes = len(settings.passes.directions_deg) or settings.passes.count
    files = [raster] * passes
    files += [scan_size(settings.lidar, settings.lidar_format, track=at) for at in tracks]
    shots = sum(file.shots for file in files)
    maplets = settings.solution.count(settings.body.radius) if settings.spc else 0
    nodes = maplets * (2 * settings.solution.half_size + 1) ** 2
    solid = settings.solid if isinstance(settings, BlindSettings) else None
    in_passes = 0 if solid else passes * settings.states.per_pass
    campaign = _campaign_images(settings)
    states = (in_passes + campaign) if settings.spc or solid else 0
    images = states if settings.images else 0
    pixels = images * settings.campaign.detector**2
    size = sum(file.bytes for file in files) + nodes * _NODE_BYTES + maplets * _LANDMARK_BYTES
    size += 6 * (settings.shape_q + 1) ** 2 * _VERTEX_BYTES + states * _STATE_BYTES
    size += len(settings.image_formats) * (pixels * _PIXEL_BYTES + images * _HEAD_BYTES)
    seconds = shots * _PER_SHOT + nodes * _PER_NODE + states * _PER_STATE
    seconds += pixels * _PER_PIXEL + images * _PER_IMAGE
    seconds *= 1.0 if settings.body.smallest_rock is None else _ROCKY
    facets = solid.facets(settings.body.radius) if solid else 0.0
    seconds += facets * _PER_FACET
    memory = _BASE_MEMORY + usable_cores() * _WORKER_MEMORY
    memory += facets * _FACET_MEMORY
    if images and not solid:
        samples = 6.0 * (2.0 * settings.body.radius / FINEST) ** 2
        memory += min(samples * _SAMPLE_BYTES, SURFACE_BYTES)
    return MissionSize(
        settings.body.radius, len(files), shots, sum(file.returns for file in files),
        maplets, states, images,
        float(size), _BASE_SECONDS + seconds / usable_cores(), memory,
    )  # fmt: skip


def _campaign_images(settings: MissionSettings) -> int:
    if isinstance(settings, BlindSettings):
        return len(blind_stations(settings))
    return settings.campaign.images


def check_room(root: Path, size: MissionSize) -> None:
    """Refuse a mission that does not fit on the disk; its existing files are taken into account.

    Raises
    ------
    WorkspaceError
        If the disk of `root` lacks room.
    """
    place = root
    while not place.exists():
        place = place.parent
    there = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    free = shutil.disk_usage(place).free
    wanted = size.bytes * _RESERVE - there
    if wanted > free:
        raise WorkspaceError(
            f"needs {_amount(wanted)} more, and the disk has {_amount(free)} free",
            root,
            "free some space, or choose another disk or a smaller preset",
        )


def _amount(count: float) -> str:
    """Return a number of bytes with a suitable unit."""
    for unit in ("kB", "MB", "GB"):
        count /= 1000.0
        if count < 1000.0:
            return f"{count:.3g} {unit}"
    return f"{count / 1000.0:.3g} TB"


def _duration(seconds: float) -> str:
    """Return a time with a suitable unit."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
