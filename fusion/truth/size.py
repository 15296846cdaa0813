"""How large a synthetic mission becomes, and how long it takes: known before it is made."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fusion.executor import usable_cores
from fusion.truth.presets import MissionSettings
from spcola.errors import WorkspaceError

# Of one core, as measured on the machine where the bench was built; a guide, not a promise.
_SECONDS_PER_RETURN = 25e-6
_SECONDS_PER_MAPLET_NODE = 25e-6
# Of one state: its landmarks, its .SUM and .NOM.
_SECONDS_PER_STATE = 0.01
_RETURN_BYTES = {"ola": 170}
# Heights and albedo of a .MAP and heights of a .SIG: two bytes and one, and one of sigma.
_NODE_BYTES = 6
_VERTEX_BYTES = 40
_STATE_BYTES = 8_000
# Numpy, Numba and the program itself; and what a worker holds of a scan in hand.
_BASE_BYTES = 300e6
_BYTES_PER_RETURN_IN_HAND = 400
# A disk that is full to the last byte helps nobody.
_RESERVE = 1.02


@dataclass(frozen=True)
class MissionSize:
    """What a mission will be.

    Attributes
    ----------
    scans, returns : int
        Lidar scans; shots of all of them together.
    maplets, states : int
        Of the SPC solution.
    bytes : float
        On disk.
    seconds : float
        Estimated for the cores that this process may use.
    memory_bytes : float
        Estimated, at most.
    """

    scans: int
    returns: int
    maplets: int
    states: int
    bytes: float
    seconds: float
    memory_bytes: float

    def lines(self) -> Iterator[str]:
        """Yield the size in words."""
        yield f"{self.scans} scans, {self.returns:,} returns"
        if self.maplets:
            yield f"{self.maplets} maplets, {self.states} states"
        yield f"{_amount(self.bytes)} on disk, {_amount(self.memory_bytes)} of memory"
        yield f"about {_duration(self.seconds)} on {usable_cores()} cores"

    def as_dict(self) -> dict[str, Any]:
        """Return all of it in JSON types."""
        return asdict(self)


def mission_size(settings: MissionSettings) -> MissionSize:
    """Return what a mission of these settings will be."""
    lidar, solution = settings.lidar, settings.solution
    scans = settings.passes.count
    per_scan = int(np.ceil(np.sqrt(lidar.shots))) ** 2
    returns = scans * per_scan
    maplets = solution.count(settings.body.radius) if settings.spc else 0
    nodes = maplets * (2 * solution.half_size + 1) ** 2
    states = scans * settings.states.per_pass if settings.spc else 0
    size = returns * _RETURN_BYTES[settings.lidar_format] + nodes * _NODE_BYTES
    size += 6 * (settings.shape_q + 1) ** 2 * _VERTEX_BYTES + states * _STATE_BYTES
    seconds = returns * _SECONDS_PER_RETURN + nodes * _SECONDS_PER_MAPLET_NODE
    seconds = (seconds + states * _SECONDS_PER_STATE) / usable_cores()
    memory = _BASE_BYTES + usable_cores() * per_scan * _BYTES_PER_RETURN_IN_HAND
    return MissionSize(scans, returns, maplets, states, float(size), seconds, memory)


def check_room(root: Path, size: MissionSize) -> None:
    """Refuse a mission that the disk has no room for; what is there of it already counts.

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
    """Return a number of bytes with a unit that keeps it short."""
    for unit in ("kB", "MB", "GB"):
        count /= 1000.0
        if count < 1000.0:
            return f"{count:.3g} {unit}"
    return f"{count / 1000.0:.3g} TB"


def _duration(seconds: float) -> str:
    """Return a time in the unit that people would take."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
