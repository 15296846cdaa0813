"""Geolocation by the SPICE kernels of a workspace, and what they cover."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fusion.pipeline import StageContext
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings.inputs import SpiceSettings
from fusion.workspace.settings.processing import MapolaSettings
from lidar.formats.native import scan_summary
from lidar.geolocation import KernelPlace, MirrorAngles
from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.navigation import Spin, utc_from_et
from spcola.spice import KernelSet, KernelUse

# Times of each scan at which the rotation is compared, and about the most of all scans.
_TIMES_A_SCAN, _MOST_TIMES = 5, 500


def kernel_place(
    workspace: Workspace,
    table: SpiceSettings,
    change: tuple[Spin, Spin] | None,
    *,
    max_gap_s: float,
) -> KernelPlace | None:
    """Return the geolocation by the kernels of `[spice]`; None without kernels.

    States and attitudes further apart than `max_gap_s`, seconds, are not interpolated between.

    Raises
    ------
    SettingsError
        If a setting that kernels need is missing, or the rotation is corrected (`change`) too.
    KernelError
        If a kernel is missing, or they disagree about the rotation.
    """
    if not table.kernels:
        return None
    _check(workspace, table, change)
    use = KernelUse(table.body, partial(_extent, workspace), "[spice] prime_meridian")
    paths = [workspace.root / name for name in table.kernels]
    kernels = KernelSet(paths, prime_meridian=table.prime_meridian or None, use=use)
    reference = None
    if table.reference:
        paths = [workspace.root / name for name in table.reference]
        chosen = table.reference_prime_meridian or None
        its_use = replace(use, setting="[spice] reference_prime_meridian")
        reference = KernelSet(paths, prime_meridian=chosen, use=its_use)
    mirror, scale = np.radians(table.mirror_deg), table.mirror_scale
    return KernelPlace(
        kernels,
        table.spacecraft,
        table.body,
        table.frame,
        reference,
        np.radians(table.boresight_deg),
        np.array(table.pupil_m),
        MirrorAngles((mirror[0], mirror[1]), (scale[0], scale[1])),
        max_gap_s,
        table.pointing_tolerance_s,
    )


def _check(workspace: Workspace, table: SpiceSettings, change: tuple[Spin, Spin] | None) -> None:
    """Refuse settings of kernels that are incomplete or contradict each other."""
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
            "must be given with a frame: the pointing with which the files were geolocated",
            f"{where} reference",
        )
    if change is not None:
        raise SettingsError(
            "the rotation is that of the kernels",
            f"{workspace.root / SETTINGS_FILE}: [spin]",
            "set its shifts to 0, or correct the PCK",
        )


def _extent(workspace: Workspace) -> tuple[FloatArray, float]:
    """Return some times of each scan, s, and the largest coordinate of returns, metres.

    Without scans they are empty and 0.
    """
    summaries = [scan_summary(path) for path in workspace.scan_paths()]
    spans = [one.time_span for one in summaries if np.isfinite(one.time_span).all()]
    times = np.concatenate([np.empty(0), *(np.linspace(*span, _TIMES_A_SCAN) for span in spans)])
    radius = max((float(np.nan_to_num(np.abs(one.bounds)).max()) for one in summaries), default=0.0)
    return times[:: max(1, len(times) // _MOST_TIMES)], radius


def kernel_paths(workspace: Workspace, table: SpiceSettings) -> list[Path]:
    """Return the kernels of `[spice]`, with the kernels that meta-kernels list."""
    place = kernel_place(workspace, table, None, max_gap_s=np.inf)
    if place is None:
        return []
    sets = [place.kernels] + ([place.reference] if place.reference is not None else [])
    return list(dict.fromkeys(path for kernels in sets for path in kernels.paths))


def advice_on_unplaced(context: StageContext, lost: int, count: int) -> str:
    """Return what to do if `lost` of `count` returns of a `context` cannot be geolocated."""
    workspace, table = context.workspace, context.table(MapolaSettings)
    place = kernel_place(workspace, context.table(SpiceSettings), None, max_gap_s=table.max_gap_s)
    text = f"{lost} of {count} returns cannot be geolocated"
    if place is None:
        return f"{text}: use scans taken with the images, or widen [mapolas] max_gap_s"
    spans = [scan_summary(path).time_span for path in workspace.scan_paths()]
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    return (
        f"{text}, {span_text(first, last)}, by the kernels: {coverage_text(place)}; give kernels "
        "of the scans' times, or widen [mapolas] max_gap_s"
    )


def coverage_text(place: KernelPlace) -> str:
    """Return one clause: the times for which the kernels have the place of the lidar."""
    windows = place.coverage.windows()
    if not len(windows):
        whole = replace(place, max_gap_s=np.inf).coverage.windows()
        if not len(whole):
            what = f"the pointing of {place.frame} and " if place.frame else ""
            return f"they have no data on {what}the place of {place.spacecraft} at any time"
        windows = np.column_stack([whole.ravel(), whole.ravel()])
    span = span_text(windows[0, 0], windows[-1, 1])
    gap = f"max_gap_s = {place.max_gap_s:g} s"
    if np.all(windows[:, 0] == windows[:, 1]):
        return f"all their states, of {span}, are more than {gap} apart"
    apart = f" in {len(windows)} spans of states no more than {gap} apart"
    return f"they cover {span}{apart if len(windows) > 1 else ''}"


def span_text(first: float, last: float) -> str:
    """Return the UTC of a span of ephemeris times, s, as text."""
    known = np.isfinite([first, last]).all()
    return " to ".join(utc_texts(first, last)) if known else "unknown times"


def utc_texts(*times: float) -> list[str]:
    """Return the UTC of ephemeris times (s) to the second."""
    return [utc_from_et(float(time), 0) for time in times]
