"""Geolocation of the returns of a workspace: as in their files, or by its settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from fusion.scene.geolocation.kernels import kernel_paths, kernel_place
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import Settings
from fusion.workspace.settings.inputs import SpiceSettings, SpinSettings
from fusion.workspace.settings.processing import MapolaSettings
from lidar.formats.native import ScanFile, times_of
from lidar.geolocation import (
    Geolocation,
    KernelPlace,
    RangeShift,
    find_geolocation,
    scan_trajectory,
)
from lidar.scan_store import ScanStore
from lidar.scans import Scan, ScanSummary
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, SettingsError
from spcola.navigation import Spin, Trajectory

_SPIN = tuple(field.name for field in fields(Spin))


def located_store(
    workspace: Workspace,
    table: MapolaSettings,
    spin: SpinSettings,
    spice: SpiceSettings,
    *,
    arc_s: float = np.inf,
) -> ScanStore:
    """Open the returns of all scans, geolocated by `[mapolas]`, `[spin]` and `[spice]`.

    Parameters
    ----------
    workspace : Workspace
    table : MapolaSettings
    spin : SpinSettings
    spice : SpiceSettings
    arc_s : float
        Scans that last longer, seconds, are cut into arcs.

    Raises
    ------
    SettingsError
        If the rotation is corrected but not stated, or both kernels and states of images are to
        geolocate the returns.
    KernelError
        If a kernel is missing or refused.
    """
    locator = geolocator(workspace, spin, spice, max_gap_s=table.max_gap_s)
    if table.trajectory == "spc":
        if locator.place is not None:
            raise SettingsError(
                "kernels and the states of images cannot both geolocate returns",
                f"{workspace.root / SETTINGS_FILE}: [mapolas] trajectory",
                "choose reference, or empty [spice] kernels",
            )
        locator = replace(locator, trajectory=Trajectory.from_images(workspace.images()))
    locate = locator.of_file if locator.moves else None
    return ScanStore(workspace.scan_paths(), locate=locate, arc_s=arc_s)


def return_paths(workspace: Workspace, settings: Settings) -> list[Path]:
    """Return the files of a `workspace` on which places of returns depend, by the `settings`.

    These are scans, states of images and kernels.
    """
    paths = [*workspace.scan_paths(), *kernel_paths(workspace, settings.spice)]
    if settings.mapolas.trajectory == "spc":
        paths += workspace.state_files()
    return paths


def _radius_of(summary: ScanSummary) -> float:
    """Return an upper limit of the distance of a scan's returns from the origin, metres."""
    return float(np.linalg.norm(np.nan_to_num(np.abs(summary.bounds)).max(axis=0)))


@dataclass(frozen=True, eq=False)
class Geolocator:
    """Geolocates returns by the settings of a workspace.

    Parameters
    ----------
    range_m : float
        Added to the ranges.
    change : (Spin, Spin), optional
        The stated and the corrected rotation.
    place : KernelPlace, optional
        Geolocation by kernels.
    trajectory : Trajectory, optional
        Trajectory of the states of images, instead of kernels.
    max_gap_s : float
        States of images further apart, seconds, are not interpolated between.
    """

    range_m: float = 0.0
    change: tuple[Spin, Spin] | None = None
    place: KernelPlace | None = None
    trajectory: Trajectory | None = None
    max_gap_s: float = np.inf

    @property
    def moves(self) -> bool:
        """Whether returns are moved from their places in the files."""
        return bool(self.range_m) or any(
            part is not None for part in (self.change, self.place, self.trajectory)
        )

    def of_file(self, file: ScanFile) -> Geolocation:
        """Return how the returns of a file move; without times or positions none has a place."""

        def times() -> list[FloatArray]:
            if self.place is None:  # a rotation needs the span only
                return [np.array(file.summary.time_span)]
            return [np.unique(times_of(block)) for block in file.blocks]

        return self._find(file.trajectory, _radius_of(file.summary), times)

    def located(self, scan: Scan) -> tuple[Scan, float]:
        """Return the geolocated scan, and the error of places by interpolation, metres.

        Returns without a place are left out, and counted as rejected.
        """
        if not (self.moves and len(scan)):
            return scan, 0.0
        radius = float(np.linalg.norm(scan.points, axis=1).max(initial=0.0))
        move = self._find(lambda: scan_trajectory(scan), radius, lambda: [scan.time])
        return move.apply_to_scan(scan), move.error_m

    def _find(
        self,
        path: Callable[[], Trajectory],
        radius: float,
        times: Callable[[], Sequence[FloatArray]],
    ) -> Geolocation:
        """Return how returns within `radius`, metres, move that were geolocated by a `path`."""
        try:
            if self.place is not None:
                move = self.place.geolocation(path(), radius, _known(times()))
            elif self.trajectory is not None:
                move = find_geolocation(
                    path(),
                    radius,
                    spin=self.change,
                    trajectory=self.trajectory,
                    max_gap_s=self.max_gap_s,
                )
            elif self.change is not None:
                known = _known(times())
                if not len(known):
                    return Geolocation(moves=True)
                span = (float(known[0]), float(known[-1]))
                move = Geolocation.by_rotation(span, radius, *self.change)
            else:
                move = Geolocation()
            if self.range_m:
                there = path()
                move = replace(move, ranges=RangeShift(self.range_m, there.time, there.position))
        except InvalidValueError:
            return Geolocation(moves=True)
        return move


def geolocator(
    workspace: Workspace, spin: SpinSettings, spice: SpiceSettings, *, max_gap_s: float
) -> Geolocator:
    """Return the geolocation by `[spin]` and `[spice]`.

    Parameters
    ----------
    workspace : Workspace
    spin : SpinSettings
    spice : SpiceSettings
    max_gap_s : float
        States of kernels or images further apart, seconds, are not interpolated between.

    Raises
    ------
    SettingsError, KernelError
        As for :func:`located_store`.
    """
    change = spin_change(workspace, spin)
    place = kernel_place(workspace, spice, change, max_gap_s=max_gap_s)
    return Geolocator(spice.range_m, change, place, max_gap_s=max_gap_s)


def _known(times: Sequence[FloatArray]) -> FloatArray:
    """Return the finite times (N,), s, sorted and without duplicates."""
    found = np.unique(np.concatenate([np.empty(0), *times]))
    return found[np.isfinite(found)]


def spin_change(workspace: Workspace, table: SpinSettings) -> tuple[Spin, Spin] | None:
    """Return the stated and the corrected rotation; None without a correction.

    Raises
    ------
    SettingsError
        If the rotation is corrected but not stated.
    """
    stated, corrected = rotations(table)
    if corrected == stated:
        return None
    if table.rate_deg_per_day == 0.0:
        raise SettingsError(
            "must be stated if the rotation is corrected",
            f"{workspace.root / SETTINGS_FILE}: [spin] rate_deg_per_day",
            "state pole, meridian and rate with which the lidar files were geolocated",
        )
    return stated, corrected


def rotations(table: SpinSettings) -> tuple[Spin, Spin]:
    """Return the rotation that [spin] states, and the corrected one.

    Parameters
    ----------
    table : SpinSettings
    """
    before = {name: getattr(table, name) for name in _SPIN}
    after = {name: value + getattr(table, f"shift_{name}") for name, value in before.items()}
    return Spin(**before), Spin(**after)
