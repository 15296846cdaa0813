"""Forecast of one stage."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from fusion.runtime.machine import PROGRAM_BYTES


class Basis(StrEnum):
    """What a forecast rests on."""

    UP_TO_DATE = "up to date"
    SAMPLE = "sample"
    """Items of the stage itself, which were timed and kept."""
    SYNTHETIC = "synthetic"
    """Made-up items of the same size, as inputs of the stage do not exist yet."""
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class StageForecast:
    """What a stage will take on this machine.

    Parameters
    ----------
    stage : str
    items : int
        Parts of its work: maplets, pairs of bigmaps, scans.
    kept : int
        Number of them, estimated from a sample, that an earlier or interrupted run left finished.
    seconds : float
        Without compiling kernels, which happens once; NaN if unknown.
    worker_bytes : float
        Memory of one worker beyond that of the program.
    workers : int
    disk_bytes : float
        Of results and of kept items that do not exist yet.
    basis : Basis
    reason : str
        Why it is unknown.
    details : mapping
        Further numbers of the stage, in JSON types.
    shared_bytes : float
        Memory that all workers share: the shape and its ray caster.
    """

    stage: str
    items: int = 0
    kept: int = 0
    seconds: float = 0.0
    worker_bytes: float = 0.0
    workers: int = 1
    disk_bytes: float = 0.0
    basis: Basis = Basis.UP_TO_DATE
    reason: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)
    shared_bytes: float = 0.0

    @property
    def memory_bytes(self) -> float:
        """Memory of the whole program, without the system's cache of files."""
        return PROGRAM_BYTES + self.shared_bytes + self.workers * self.worker_bytes

    def as_json(self) -> dict[str, Any]:
        """Return it in JSON types, with units in the keys."""
        return {
            "basis": self.basis.value,
            "items": self.items,
            "kept": self.kept,
            "seconds": self.seconds,
            "memory_mb": self.memory_bytes / 1e6,
            "memory_per_worker_mb": self.worker_bytes / 1e6,
            "disk_mb": self.disk_bytes / 1e6,
            "reason": self.reason,
        }


def forecast_json(found: Mapping[str, StageForecast]) -> dict[str, Any]:
    """Return forecasts in JSON types.

    Parameters
    ----------
    found : mapping of str to StageForecast
        By stage.
    """
    return {name: one.as_json() for name, one in found.items()}


def forecast_lines(content: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a table of lines, one for each stage, and their sum.

    Parameters
    ----------
    content : mapping
        From :func:`forecast_json`, or read from JSON.
    """
    yield f"{'stage':10}{'items':>8}{'kept':>8}{'time':>10}{'memory, MB':>12}{'disk, MB':>10}  from"
    for stage, one in content.items():
        basis = one["basis"] + (f": {one['reason']}" if one["reason"] else "")
        if one["basis"] in (Basis.UP_TO_DATE, Basis.UNKNOWN):
            yield f"{stage:10}{'–':>8}{'–':>8}{'–':>10}{'–':>12}{'–':>10}  {basis}"
            continue
        yield (
            f"{stage:10}{one['items']:8d}{one['kept']:8d}{_time(one['seconds']):>10}"
            f"{one['memory_mb']:12.0f}{one['disk_mb']:10.1f}  {basis}"
        )
    known = [one for one in content.values() if not _is_unknown(one["seconds"])]
    seconds, disk_mb = (sum(one[key] for one in known) for key in ("seconds", "disk_mb"))
    most = max((one["memory_mb"] for one in known), default=PROGRAM_BYTES / 1e6)
    yield f"{'all':26}{_time(seconds):>10}{most:12.0f}{disk_mb:10.1f}"
    yield "time without the first compilation of kernels; nothing was run"


def _is_unknown(seconds: float | None) -> bool:
    return seconds is None or math.isnan(seconds)


def _time(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.1f} s"
