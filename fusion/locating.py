"""Where the returns of a workspace are: as their files say, or located again by its settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fusion.settings import Settings
from fusion.tables import MapolaSettings, SpiceSettings, SpinSettings
from fusion.workspace import SETTINGS_FILE, Workspace
from lidar.formats.native import ScanFile
from lidar.kernels import KernelPlace
from lidar.mirror import MirrorAngles
from lidar.rangeshift import RangeShift
from lidar.relocation import Relocation, relocated, relocation, turn_of
from lidar.reprojection import scan_trajectory
from lidar.scan import Scan
from lidar.store import ScanStore
from spcola.errors import InvalidValueError, SettingsError
from spcola.spice import KernelSet
from spcola.spin import Spin
from spcola.trajectory import Trajectory

Locator = Callable[[ScanFile], Relocation]


def located_store(
    workspace: Workspace,
    table: MapolaSettings,
    spin: SpinSettings,
    spice: SpiceSettings,
    *,
    arc_s: float = np.inf,
) -> ScanStore:
    """Open the returns of all scans where `[mapolas]`, `[spin]` and `[spice]` say that they are.

    Scans that last longer than `arc_s` seconds are cut into arcs.

    Raises
    ------
    SettingsError
        If the rotation is corrected, but is not stated, or kernels are to locate what states of
        images locate.
    KernelError
        If a kernel is missing or refused.
    """
    change = spin_change(workspace, spin)
    place = kernel_place(workspace, spice, change)
    if table.trajectory == "spc" and place is not None:
        raise SettingsError(
            "kernels and the states of images cannot both locate returns",
            f"{workspace.root / SETTINGS_FILE}: [mapolas] trajectory",
            "choose reference, or empty [spice] kernels",
        )
    locate: Locator | None
    if place is not None:
        locate = partial(_by_kernels, place)
    else:
        images = workspace.images() if table.trajectory == "spc" else None
        trajectory = None if images is None else Trajectory.from_images(images)
        locate = locator(change, trajectory, table.max_gap_s)
    if spice.range_m:
        locate = partial(_by_ranges, spice.range_m, locate)
    return ScanStore(workspace.scan_paths(), locate=locate, arc_s=arc_s)


def kernel_place(
    workspace: Workspace, table: SpiceSettings, change: tuple[Spin, Spin] | None
) -> KernelPlace | None:
    """Return where the kernels of `[spice]` put the lidar; None without kernels.

    Raises
    ------
    SettingsError
        If something is missing beside the kernels, or the rotation is corrected (`change`) too.
    KernelError
        If a kernel is missing, or they disagree about the rotation.
    """
    if not table.kernels:
        return None
    where = f"{workspace.root / SETTINGS_FILE}: [spice]"
    if not table.spacecraft or not table.body:
        raise SettingsError("must be given with kernels", f"{where} spacecraft and body")
    if not table.frame and (any(table.mounting) or table.reference):
        raise SettingsError(
            "must be given with reference, boresight_deg, pupil_m, mirror_deg or mirror_scale",
            f"{where} frame",
        )
    if table.frame and not table.reference and not any(table.mounting):
        raise SettingsError(
            "must be given with a frame: the pointing by which the files were located",
            f"{where} reference",
        )
    if change is not None:
        raise SettingsError(
            "the rotation is that of the kernels",
            f"{workspace.root / SETTINGS_FILE}: [spin]",
            "set its shifts to 0, or correct the PCK",
        )
    reference = None
    if table.reference:
        paths = [workspace.root / name for name in table.reference]
        reference = KernelSet(paths, prime_meridian=table.reference_prime_meridian or None)
    return KernelPlace(
        KernelSet(
            [workspace.root / name for name in table.kernels],
            prime_meridian=table.prime_meridian or None,
        ),
        table.spacecraft,
        table.body,
        table.frame,
        reference,
        np.radians(table.boresight_deg),
        np.array(table.pupil_m),
        MirrorAngles(
            (np.radians(table.mirror_deg[0]), np.radians(table.mirror_deg[1])),
            (table.mirror_scale[0], table.mirror_scale[1]),
        ),
    )


def kernel_paths(workspace: Workspace, table: SpiceSettings) -> list[Path]:
    """Return the kernels of `[spice]`, meta-kernels replaced by what they list."""
    place = kernel_place(workspace, table, None)
    if place is None:
        return []
    sets = [place.kernels] + ([place.reference] if place.reference is not None else [])
    return list(dict.fromkeys(path for kernels in sets for path in kernels.paths))


def return_paths(workspace: Workspace, settings: Settings) -> list[Path]:
    """Return every file that says where the returns are: scans, states of images, kernels."""
    paths = [*workspace.scan_paths(), *kernel_paths(workspace, settings.spice)]
    if settings.mapolas.trajectory == "spc":
        paths += [workspace.image_path(name) for name in workspace.image_names()]
    return paths


def _by_kernels(place: KernelPlace, file: ScanFile) -> Relocation:
    """How a scan moves; one that knows no times or positions has no place."""
    try:
        return place.relocation(file.trajectory(), _radius_of(file))
    except InvalidValueError:
        return Relocation(moves=True)


def _by_ranges(range_m: float, locate: Locator | None, file: ScanFile) -> Relocation:
    """How a scan moves whose ranges are corrected, and which `locate` locates again."""
    try:
        path = file.trajectory()
    except InvalidValueError:
        return Relocation(moves=True)
    move = Relocation() if locate is None else locate(file)
    return replace(move, ranges=RangeShift(range_m, path.time, path.position))


def _radius_of(file: ScanFile) -> float:
    """Largest distance of a scan's returns from the origin, metres, or somewhat more."""
    return float(np.linalg.norm(np.nan_to_num(np.abs(file.summary.bounds)).max(axis=0)))


def locator(
    spin: tuple[Spin, Spin] | None, trajectory: Trajectory | None, max_gap_s: float = np.inf
) -> Locator | None:
    """Return what says how a scan is located again; None where all stay where they are.

    A scan that knows no times or positions, or shares no time with the trajectory, has no place.
    """
    if spin is None and trajectory is None:
        return None

    def locate(file: ScanFile) -> Relocation:
        try:
            return relocation(
                file.trajectory(),
                _radius_of(file),
                spin=spin,
                trajectory=trajectory,
                max_gap_s=max_gap_s,
            )
        except InvalidValueError:
            return Relocation(moves=True)

    return locate


def turning(
    workspace: Workspace, spin: SpinSettings, spice: SpiceSettings
) -> Callable[[Scan], Scan]:
    """Return what brings a scan to where corrected ranges and rotation, or kernels, put it.

    Returns that have no place there are left out, and counted as rejected.

    Raises
    ------
    SettingsError, KernelError
        As :func:`located_store` does.
    """
    change = spin_change(workspace, spin)
    place = kernel_place(workspace, spice, change)

    def turn(scan: Scan) -> Scan:
        if not len(scan):
            return scan
        if spice.range_m:
            scan = _with_ranges(scan, spice.range_m)
        if change is None and place is None:
            return scan
        radius = float(np.linalg.norm(scan.points, axis=1).max())
        known = scan.time[np.isfinite(scan.time)]
        try:
            if place is not None:
                return relocated(scan, place.relocation(scan_trajectory(scan), radius))
        except InvalidValueError:
            return relocated(scan, Relocation(moves=True))
        if change is None or not len(known):
            return relocated(scan, Relocation(moves=True))
        move = turn_of((float(known.min()), float(known.max())), radius, *change)
        return relocated(scan, move)

    return turn


def _with_ranges(scan: Scan, range_m: float) -> Scan:
    """Return a scan whose ranges are longer by `range_m`, metres."""
    try:
        path = scan_trajectory(scan)
    except InvalidValueError:
        return relocated(scan, Relocation(moves=True))
    return relocated(scan, Relocation(ranges=RangeShift(range_m, path.time, path.position)))


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
        table.pole_dec_deg + table.shift_pole_dec_deg,
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
