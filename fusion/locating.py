"""Where the returns of a workspace are: as their files say, or located again by its settings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fusion.settings import MapolaSettings, SpinSettings
from fusion.workspace import SETTINGS_FILE, Workspace
from lidar.formats.native import ScanFile
from lidar.relocation import Relocation, relocated, relocation, turn_of
from lidar.scan import Scan
from lidar.store import ScanStore
from spcola.errors import InvalidValueError, SettingsError
from spcola.spin import Spin
from spcola.trajectory import Trajectory

Locator = Callable[[ScanFile], Relocation]


def located_store(workspace: Workspace, table: MapolaSettings, spin: SpinSettings) -> ScanStore:
    """Open the returns of all scans where `[mapolas]` and `[spin]` say that they are.

    Raises
    ------
    SettingsError
        If the rotation is corrected, but is not stated.
    """
    trajectory = None
    if table.trajectory == "spc":
        trajectory = Trajectory.from_images(workspace.images())
    change = spin_change(workspace, spin)
    locate = locator(change, trajectory, table.max_gap_s)
    return ScanStore(workspace.scan_paths(), locate=locate)


def locator(
    spin: tuple[Spin, Spin] | None, trajectory: Trajectory | None, max_gap_s: float = np.inf
) -> Locator | None:
    """Return what says how a scan is located again; None where all stay where they are.

    A scan that knows no times or positions, or shares no time with the trajectory, has no place.
    """
    if spin is None and trajectory is None:
        return None

    def locate(file: ScanFile) -> Relocation:
        radius = float(np.linalg.norm(np.nan_to_num(np.abs(file.summary.bounds)).max(axis=0)))
        try:
            return relocation(
                file.trajectory(), radius, spin=spin, trajectory=trajectory, max_gap_s=max_gap_s
            )
        except InvalidValueError:
            return Relocation(moves=True)

    return locate


def turning(workspace: Workspace, table: SpinSettings) -> Callable[[Scan], Scan]:
    """Return what brings a scan into the frame of the corrected rotation.

    Returns without a time have no place in it: they are left out, and counted as rejected.

    Raises
    ------
    SettingsError
        If the rotation is corrected, but is not stated.
    """
    change = spin_change(workspace, table)

    def turn(scan: Scan) -> Scan:
        known = scan.time[np.isfinite(scan.time)]
        if change is None or not len(scan):
            return scan
        if not len(known):
            return relocated(scan, Relocation(moves=True))
        radius = float(np.linalg.norm(scan.points, axis=1).max())
        move = turn_of((float(known.min()), float(known.max())), radius, *change)
        return relocated(scan, move)

    return turn


def spin_change(workspace: Workspace, table: SpinSettings) -> tuple[Spin, Spin] | None:
    """Return the stated and the corrected rotation; None where nothing is corrected.

    Raises
    ------
    SettingsError
        If the rotation is corrected, but is not stated.
    """
    stated = Spin(table.pole_ra_deg, table.pole_dec_deg, table.meridian_deg, table.rate_deg_per_day)
    corrected = Spin(
        table.pole_ra_deg + table.shift_pole_ra_deg,
        float(np.clip(table.pole_dec_deg + table.shift_pole_dec_deg, -90.0, 90.0)),
        table.meridian_deg + table.shift_meridian_deg,
        table.rate_deg_per_day + table.shift_rate_deg_per_day,
    )
    if corrected == stated:
        return None
    if table.rate_deg_per_day == 0.0:
        raise SettingsError(
            "must be stated where the rotation is corrected",
            f"{workspace.root / SETTINGS_FILE}: [spin] rate_deg_per_day",
            "state pole, meridian and rate by which the lidar files were located",
        )
    return stated, corrected
