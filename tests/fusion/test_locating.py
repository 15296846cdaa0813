"""Returns of a workspace located again: by a corrected rotation, or by the states of images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.executor import ThreadExecutor
from fusion.initialise import new_workspace
from fusion.locating import turning
from fusion.pipeline import Pipeline
from fusion.settings import Settings
from fusion.stages import ingest, mapolas
from lidar.cubes import QUANTUM_M
from lidar.formats.native import write_scan
from lidar.scan import Scan
from spcola.errors import SettingsError
from spcola.formats.map import write_maplet
from spcola.maplet import Maplet, MapletGrid
from spcola.spin import Spin, turned

STATED = Spin(85.45, -60.37, 140.69, 2011.15)
SHIFT = {"shift_pole_dec_deg": 0.05, "shift_meridian_deg": -0.2}
SPIN = {
    "pole_ra_deg": 85.45,
    "pole_dec_deg": -60.37,
    "meridian_deg": 140.69,
    "rate_deg_per_day": 2011.15,
}
CORRECTED = Spin(85.45, -60.37 + 0.05, 140.69 - 0.2, 2011.15)
BACK = {
    "pole_ra_deg": 85.45,
    "pole_dec_deg": -60.37 + 0.05,
    "meridian_deg": 140.69 - 0.2,
    "rate_deg_per_day": 2011.15,
    "shift_pole_dec_deg": -0.05,
    "shift_meridian_deg": 0.2,
}
START = 6.2e8
GRID = MapletGrid.facing([60.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 8)


def scans() -> list[Scan]:
    """Two scans over hills on a sphere of 60 m, seen from a spacecraft that drifts."""
    made = []
    for seed, name in ((1, "one"), (2, "two")):
        rng = np.random.default_rng(seed)
        count = 20_000
        away = np.column_stack([np.ones(count), rng.uniform(-0.15, 0.15, (count, 2))])
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        hills = 0.5 * np.sin(40.0 * away[:, 1]) * np.cos(35.0 * away[:, 2])
        time = START + 500.0 * seed + np.linspace(0.0, 300.0, count)
        rng.shuffle(time)
        station = np.column_stack([np.full(count, 800.0), 0.05 * (time - START), 0.0 * time])
        points = (60.0 + hills)[:, None] * away
        made.append(Scan.of_points(name, points, time=time, spacecraft=station, body="Ball"))
    return made


def rotated(scan: Scan, old: Spin, new: Spin) -> Scan:
    """The scan as its file would be by another rotation."""
    change = old.change_to(new, scan.time)
    points, station = turned(change, scan.points), turned(change, scan.spacecraft)
    return Scan.of_points(
        scan.name, points, time=scan.time, spacecraft=station, body="Ball", range=scan.range
    )


def heights(folder: Path, found: list[Scan], **tables: dict[str, object]) -> np.ndarray:
    """Heights of a mapola of these scans in a new workspace, with these settings."""
    workspace = new_workspace(folder, body="Ball")
    write_maplet(
        workspace.root / "MAPFILES" / "AA0001.MAP", Maplet("AA0001", GRID, np.zeros((17, 17)))
    )
    for scan in found:
        write_scan(workspace.root / "scans" / f"{scan.name}.h5", [scan])
    settings = Settings().with_table("mapolas", adjust=False)
    for table, changed in tables.items():
        settings = settings.with_table(table, **changed)
    stages = [ingest.STAGE, mapolas.STAGE]
    Pipeline(workspace, settings, stages, ThreadExecutor(2)).run_stage("mapolas")
    return workspace.mapola("AA0001").height


def test_mapolas_by_a_corrected_rotation_are_those_of_corrected_files(tmp_path: Path) -> None:
    found = scans()
    direct = heights(tmp_path / "direct", [rotated(scan, STATED, CORRECTED) for scan in found])
    settings = heights(tmp_path / "settings", found, spin={**SPIN, **SHIFT})
    as_stated = heights(tmp_path / "stated", found)
    # 0.2 deg are 21 cm on hills of 50 cm.
    assert np.nanmax(np.abs(settings - as_stated)) > 0.05
    # Returns that rounding carries over the rim of a cell change a few medians.
    assert np.nanquantile(np.abs(settings - direct), 0.95) < 2 * QUANTUM_M
    assert np.nanmax(np.abs(settings - direct)) < 5e-3


def test_there_and_back_gives_the_first_mapola(tmp_path: Path) -> None:
    found = scans()
    first = heights(tmp_path / "first", found)
    there = [rotated(scan, STATED, CORRECTED) for scan in found]
    back = heights(tmp_path / "back", there, spin=BACK)
    assert np.nanquantile(np.abs(back - first), 0.95) < 2 * QUANTUM_M
    assert np.nanmax(np.abs(back - first)) < 5e-3


def test_a_scan_is_turned_whole(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = Settings().with_table("spin", **SPIN, **SHIFT).spin
    for scan in scans():
        moved, right = turning(workspace, table)(scan), rotated(scan, STATED, CORRECTED)
        np.testing.assert_allclose(moved.points, right.points, atol=1e-5)
        np.testing.assert_allclose(moved.beam, right.beam, atol=1e-7)
        # The station lies 13 times as far out as the returns, for which steps are fine enough.
        np.testing.assert_allclose(moved.spacecraft, right.spacecraft, atol=2e-4)
        assert turning(workspace, Settings().spin)(scan) is scan


def test_returns_without_time_cannot_be_turned_and_are_counted(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = Settings().with_table("spin", **SPIN, **SHIFT).spin
    scan = scans()[0]
    time = scan.time.copy()
    time[:7] = np.nan
    moved = turning(workspace, table)(replace(scan, time=time))
    assert len(moved) == len(scan) - 7
    assert dict(moved.rejected) == {"no time": 7}
    none = turning(workspace, table)(replace(scan, time=np.full(len(scan), np.nan)))
    assert (len(none), dict(none.rejected)) == (0, {"no time": len(scan)})


def test_a_correction_of_an_unstated_rotation_is_refused(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = Settings().with_table("spin", shift_meridian_deg=0.1).spin
    with pytest.raises(SettingsError, match=r"\[spin\] rate_deg_per_day: must be stated"):
        turning(workspace, table)
