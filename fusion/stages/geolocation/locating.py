"""Where the returns of a workspace are: as their files say, or located again by its settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import MapolaSettings, Settings, SpiceSettings, SpinSettings
from lidar.archive import ScanStore
from lidar.formats.native import ScanFile, scan_summary, times_of
from lidar.geolocation import (
    KernelPlace,
    MirrorAngles,
    RangeShift,
    Relocation,
    relocated,
    relocation,
    scan_trajectory,
    turn_of,
)
from lidar.scans import Scan, ScanSummary
from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError, SettingsError
from spcola.navigation import Spin, Trajectory
from spcola.spice import KernelSet, KernelUse

Locator = Callable[[ScanFile], Relocation]

# The rotation is compared at so many times of each scan, and so many in all, or a few more.
_TIMES_A_SCAN, _MOST_TIMES = 5, 500
_SPIN = tuple(field.name for field in fields(Spin))


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
    place = kernel_place(workspace, spice, change, max_gap_s=table.max_gap_s)
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
    workspace: Workspace,
    table: SpiceSettings,
    change: tuple[Spin, Spin] | None,
    *,
    max_gap_s: float,
) -> KernelPlace | None:
    """Return where the kernels of `[spice]` put the lidar; None without kernels.

    States and attitudes further apart than `max_gap_s`, seconds, are not interpolated between.

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
    use = KernelUse(table.body, partial(_extent, workspace), "[spice] prime_meridian")
    reference = None
    if table.reference:
        paths = [workspace.root / name for name in table.reference]
        chosen = table.reference_prime_meridian or None
        its_use = replace(use, setting="[spice] reference_prime_meridian")
        reference = KernelSet(paths, prime_meridian=chosen, use=its_use)
    return KernelPlace(
        KernelSet(
            [workspace.root / name for name in table.kernels],
            prime_meridian=table.prime_meridian or None,
            use=use,
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
        max_gap_s,
        table.pointing_tolerance_s,
    )


def _extent(workspace: Workspace) -> tuple[FloatArray, float]:
    """Times, s, at which the rotation is used, some of each scan; and how far returns reach, m.

    The latter is along one axis. Without scans both are empty or 0.
    """
    summaries = [scan_summary(path) for path in workspace.scan_paths()]
    spans = [one.time_span for one in summaries if np.isfinite(one.time_span).all()]
    times = np.concatenate([np.empty(0), *(np.linspace(*span, _TIMES_A_SCAN) for span in spans)])
    radius = max((float(np.nan_to_num(np.abs(one.bounds)).max()) for one in summaries), default=0.0)
    return times[:: max(1, len(times) // _MOST_TIMES)], radius


def kernel_paths(workspace: Workspace, table: SpiceSettings) -> list[Path]:
    """Return the kernels of `[spice]`, meta-kernels replaced by what they list."""
    place = kernel_place(workspace, table, None, max_gap_s=np.inf)
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
        times = [np.unique(times_of(block)) for block in file.blocks]
        return place.relocation(file.trajectory(), _radius_of(file.summary), _known(times))
    except InvalidValueError:
        return Relocation(moves=True)


def _known(times: Sequence[FloatArray]) -> FloatArray:
    """Return the times (N,), s, that are known, sorted and single."""
    found = np.unique(np.concatenate([np.empty(0), *times]))
    return found[np.isfinite(found)]


def _by_ranges(range_m: float, locate: Locator | None, file: ScanFile) -> Relocation:
    """How a scan moves whose ranges are corrected, and which `locate` locates again."""
    try:
        path = file.trajectory()
    except InvalidValueError:
        return Relocation(moves=True)
    move = Relocation() if locate is None else locate(file)
    return replace(move, ranges=RangeShift(range_m, path.time, path.position))


def _radius_of(summary: ScanSummary) -> float:
    """Largest distance of a scan's returns from the origin, metres, or somewhat more."""
    return float(np.linalg.norm(np.nan_to_num(np.abs(summary.bounds)).max(axis=0)))


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
                _radius_of(file.summary),
                spin=spin,
                trajectory=trajectory,
                max_gap_s=max_gap_s,
            )
        except InvalidValueError:
            return Relocation(moves=True)

    return locate


@dataclass(frozen=True, eq=False)
class Turning:
    """What brings a scan to where corrected ranges and rotation, or kernels, put it.

    Parameters
    ----------
    range_m : float
        Added to the ranges.
    change : (Spin, Spin), optional
        The stated and the corrected rotation.
    place : KernelPlace, optional
        Where kernels put the lidar.
    """

    range_m: float
    change: tuple[Spin, Spin] | None
    place: KernelPlace | None

    def __call__(self, scan: Scan) -> Scan:
        """Return the scan; returns without a place are left out, and counted as rejected."""
        return self.located(scan)[0]

    def located(self, scan: Scan) -> tuple[Scan, float]:
        """Return the scan, and by how much interpolation puts its returns wrong, metres."""
        if not len(scan):
            return scan, 0.0
        if self.range_m:
            scan = _with_ranges(scan, self.range_m)
        if self.change is None and self.place is None:
            return scan, 0.0
        move = self._move(scan)
        return relocated(scan, move), move.error_m

    def _move(self, scan: Scan) -> Relocation:
        radius = float(np.linalg.norm(scan.points, axis=1).max(initial=0.0))
        times = _known([scan.time])
        if self.place is not None:
            try:
                return self.place.relocation(scan_trajectory(scan), radius, times)
            except InvalidValueError:
                return Relocation(moves=True)
        if self.change is None or not len(times):
            return Relocation(moves=True)
        return turn_of((float(times[0]), float(times[-1])), radius, *self.change)


def turning(
    workspace: Workspace, spin: SpinSettings, spice: SpiceSettings, *, max_gap_s: float
) -> Turning:
    """Return what brings a scan to where corrected ranges and rotation, or kernels, put it.

    Returns that have no place there are left out, and counted as rejected: so are those between
    states of kernels further apart than `max_gap_s`, seconds.

    Raises
    ------
    SettingsError, KernelError
        As :func:`located_store` does.
    """
    change = spin_change(workspace, spin)
    place = kernel_place(workspace, spice, change, max_gap_s=max_gap_s)
    return Turning(spice.range_m, change, place)


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
    before = {name: getattr(table, name) for name in _SPIN}
    after = {name: value + getattr(table, f"shift_{name}") for name, value in before.items()}
    stated, corrected = Spin(**before), Spin(**after)
    if corrected == stated:
        return None
    if table.rate_deg_per_day == 0.0:
        raise SettingsError(
            "must be stated where the rotation is corrected",
            f"{workspace.root / SETTINGS_FILE}: [spin] rate_deg_per_day",
            "state pole, meridian and rate by which the lidar files were located",
        )
    return stated, corrected
