"""Returns of a workspace located again: by a corrected rotation, or by the states of images."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import spiceypy
from command_line import called, refused
from distributed import LocalCluster
from kernel_files import spk
from scipy.spatial import KDTree

from fusion.pipeline import Pipeline
from fusion.runtime import ClusterExecutor, Executor, ThreadExecutor
from fusion.scene.geolocation import located_store, return_paths
from fusion.scene.geolocation.kernels import kernel_paths
from fusion.scene.geolocation.locating import geolocator, spin_change
from fusion.stages.ingest import stage as ingest
from fusion.stages.mapolas import stage as mapolas
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.settings import Settings, write_settings
from lidar.formats.native import write_scan
from lidar.scans import Scan
from lidar.scans.cubes import QUANTUM_M, Box
from spcola.camera import Camera, SpcImage
from spcola.errors import SettingsError
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid
from spcola.navigation import Spin, utc_from_et
from spcola.spice import KernelSet

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
    points, station = (old.moved(v, new, scan.time) for v in (scan.points, scan.spacecraft))
    return Scan.of_points(
        scan.name, points, time=scan.time, spacecraft=station, body="Ball", range=scan.range
    )


def workspace_of(folder: Path, found: list[Scan]) -> Workspace:
    """A new workspace with one flat maplet, and scans."""
    workspace = new_workspace(folder, body="Ball")
    flat = Maplet("AA0001", GRID, np.zeros((17, 17)))
    write_maplet(workspace.root / "MAPFILES" / "AA0001.MAP", flat)
    for scan in found:
        write_scan(workspace.root / "scans" / f"{scan.name}.h5", [scan])
    return workspace


def heights(
    folder: Path,
    found: list[Scan],
    executor: Executor | None = None,
    **tables: dict[str, object],
) -> np.ndarray:
    """Heights of a mapola of these scans in a new workspace, with these settings."""
    workspace = workspace_of(folder, found)
    settings = Settings().with_table("mapolas", adjust=False)
    for table, changed in tables.items():
        settings = settings.with_table(table, **changed)
    stages = [ingest.STAGE, mapolas.STAGE]
    Pipeline(workspace, settings, stages, executor or ThreadExecutor(2)).run_stage("mapolas")
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
        moved, right = (
            geolocator(workspace, table, Settings().spice, max_gap_s=600.0).located(scan)[0],
            rotated(scan, STATED, CORRECTED),
        )
        np.testing.assert_allclose(moved.points, right.points, atol=1e-5)
        np.testing.assert_allclose(moved.beam, right.beam, atol=1e-7)
        # The station lies 13 times as far out as the returns, for which steps are fine enough.
        np.testing.assert_allclose(moved.spacecraft, right.spacecraft, atol=2e-4)
        assert (
            geolocator(workspace, Settings().spin, Settings().spice, max_gap_s=600.0).located(scan)[
                0
            ]
            is scan
        )


def test_returns_without_time_cannot_be_turned_and_are_counted(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = Settings().with_table("spin", **SPIN, **SHIFT).spin
    scan = scans()[0]
    time = scan.time.copy()
    time[:7] = np.nan
    moved = geolocator(workspace, table, Settings().spice, max_gap_s=600.0).located(
        replace(scan, time=time)
    )[0]
    assert len(moved) == len(scan) - 7
    assert dict(moved.rejected) == {"no time": 7}
    none = geolocator(workspace, table, Settings().spice, max_gap_s=600.0).located(
        replace(scan, time=np.full(len(scan), np.nan))
    )[0]
    assert (len(none), dict(none.rejected)) == (0, {"no time": len(scan)})


def test_a_correction_of_an_unstated_rotation_is_refused(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = Settings().with_table("spin", shift_meridian_deg=0.1).spin
    with pytest.raises(SettingsError, match=r"\[spin\] rate_deg_per_day: must be stated"):
        geolocator(workspace, table, Settings().spice, max_gap_s=600.0)


@pytest.mark.parametrize("name", [field.name for field in fields(Spin)])
def test_every_number_of_a_rotation_is_stated_and_corrected(tmp_path: Path, name: str) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    v34 = {**SPIN, "quadratic_deg_per_day2": 1.815e-6, "pole_ra_rate_deg_per_century": 0.1}
    table = Settings().with_table("spin", **v34, **{f"shift_{name}": 1e-3}).spin
    before, after = spin_change(workspace, table)
    assert before == Spin(**v34)
    assert after == replace(before, **{name: getattr(before, name) + 1e-3})


def test_a_pole_is_not_moved_over_a_pole() -> None:
    with pytest.raises(SettingsError, match=r"shift_pole_dec_deg should add up to -90 to 90"):
        Settings().with_table("spin", **SPIN, shift_pole_dec_deg=-40.0)


PCK = """KPL/PCK
\\begindata
  BODY2101955_POLE_RA  = ( 85.45 0.0 0.0 )
  BODY2101955_POLE_DEC = ( -60.37 0.0 0.0 )
  BODY2101955_PM       = ( 140.69 0.0 0.0 )
\\begintext
"""


def kernels(folder: Path, shift: list[float]) -> dict[str, object]:
    """Kernels of a body that stands still and the stations of `scans`, moved by `shift` metres."""
    text, path = folder / "body.tpc", folder / "craft.bsp"
    text.write_text(PCK)
    times = np.linspace(400.0, 1400.0, 11)
    place = np.column_stack([np.full(11, 800.0), 0.05 * times, 0.0 * times]) + shift
    with KernelSet(text).load():
        turn = spiceypy.tipbod("J2000", 2101955, START)
    velocity = np.tile([0.0, 0.05, 0.0], (11, 1))
    states = np.concatenate([place @ turn, velocity @ turn], axis=1) / 1000.0
    spk(path, START + times, states)
    return {"kernels": [str(text), str(path)], "spacecraft": "-999", "body": 2101955}


def test_mapolas_move_as_the_trajectory_of_the_kernels_does(tmp_path: Path) -> None:
    found = scans()
    as_read = heights(tmp_path / "read", found)
    by_kernels = heights(tmp_path / "kernels", found, spice=kernels(tmp_path, [0.3, 0.0, 0.0]))
    rise = by_kernels - as_read
    assert np.isfinite(rise).mean() > 0.9
    np.testing.assert_allclose(np.nanmedian(rise), 0.3, atol=QUANTUM_M)
    assert np.nanquantile(np.abs(rise - 0.3), 0.95) < 3 * QUANTUM_M


def test_kernels_locate_returns_on_a_cluster_to_the_same_bits(tmp_path: Path) -> None:
    """Each worker opens the store and loads the kernels itself."""
    found = scans()
    spice = kernels(tmp_path, [0.3, 0.0, 0.0])
    here = heights(tmp_path / "here", found, spice=spice)
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        executor = ClusterExecutor(str(cluster.scheduler_address))
        there = heights(tmp_path / "there", found, executor, spice=spice)
        executor.close()
    assert np.isfinite(here).mean() > 0.9
    np.testing.assert_array_equal(there, here)


def test_scans_are_moved_whole_by_kernels(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    table = kernels(tmp_path, [0.0, 2.0, -1.0])
    spice = Settings().with_table("spice", **table).spice
    for scan in scans():
        moved = geolocator(workspace, Settings().spin, spice, max_gap_s=600.0).located(scan)[0]
        shift = np.tile([0.0, 2.0, -1.0], (len(scan), 1))
        np.testing.assert_allclose(moved.points - scan.points, shift, atol=1e-9)
        np.testing.assert_allclose(moved.spacecraft - scan.spacecraft, shift, atol=1e-9)
        np.testing.assert_allclose(moved.beam, scan.beam, atol=1e-9)
    assert kernel_paths(workspace, spice) == [Path(name) for name in table["kernels"]]


def test_returns_of_the_store_lie_where_scans_put_them_when_the_mirror_is_corrected(
    tmp_path: Path,
) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    for scan in scans():
        write_scan(workspace.root / "scans" / f"{scan.name}.h5", [scan])
    wrong = {"frame": "J2000", "mirror_deg": [0.1, -0.05], "mirror_scale": [0.0, 2e-3]}
    settings = Settings().with_table("spice", **kernels(tmp_path, [0.0, 0.0, 0.0]), **wrong)
    store = located_store(workspace, settings.mapolas, settings.spin, settings.spice)
    locator = geolocator(workspace, settings.spin, settings.spice, max_gap_s=600.0)
    right = np.concatenate([locator.located(scan)[0].points for scan in scans()])
    read = np.concatenate([scan.points for scan in scans()])
    assert np.median(np.linalg.norm(right - read, axis=1)) > 1.0
    box = Box([60.0, 1.0, -1.0], np.eye(3), [10.0, 4.0, 4.0])
    found = store.returns_inside(box).points
    apart, _ = KDTree(right).query(found)
    assert apart.max() < 1e-3
    assert len(found) == pytest.approx(np.count_nonzero(box.holds(right)), abs=5)
    # So it is on another machine of a cluster, to which the store is sent.
    sent = pickle.loads(pickle.dumps(store))
    np.testing.assert_array_equal(sent.returns_inside(box).points, found)


def test_mapolas_move_as_the_states_of_images_do(tmp_path: Path) -> None:
    workspace = workspace_of(tmp_path / "ws", scans())
    camera = Camera(100.0, [256, 256], [[60.0, 0, 0], [0, 60.0, 0]], 512, 512)
    rng = np.random.default_rng(5)
    for number, time in enumerate(np.linspace(450.0, 1350.0, 10)):
        off = [0.3, 0.0, 0.0] + 0.02 * rng.normal(size=3)
        place = np.array([800.0, 0.05 * time, 0.0]) + off
        utc = utc_from_et(START + time, 6)
        image = SpcImage(f"I{number:03d}", utc, camera, -place, np.eye(3), [1.0, 0, 0])
        write_summary(workspace.image_path(image.name), image)
    result = {}
    for trajectory in ("reference", "spc"):
        settings = Settings().with_table("mapolas", adjust=False, trajectory=trajectory)
        write_settings(workspace.root / SETTINGS_FILE, settings)
        summary = called("mapolas", workspace.root)["summary"]
        result[trajectory] = summary, workspace.mapola("AA0001")
    (summary, by_images), (as_read, read) = result["spc"], result["reference"]
    rise = np.nanmedian(by_images.height - read.height)
    assert rise == pytest.approx(0.3, abs=0.03)
    # States that wander by 2 cm an axis between each other are 2 to 4 cm off halfway.
    assert 0.01 < summary["located_within_m"] < 0.05
    assert "located_within_m" not in as_read
    # Whatever is made of these returns, bigmaps among it, is made again when a state changes.
    assert workspace.image_path("I000") in return_paths(workspace, settings)


def longer(scan: Scan, by: float) -> Scan:
    """The scan as its file would be if every range were longer by so many metres."""
    return replace(scan, points=scan.points + by * scan.beam, range=scan.range + by)


def test_mapolas_by_corrected_ranges_are_those_of_corrected_files(tmp_path: Path) -> None:
    found = scans()
    corrected = heights(tmp_path / "ranges", found, spice={"range_m": -1.15})
    files = heights(tmp_path / "files", [longer(scan, -1.15) for scan in found])
    assert np.isfinite(files).mean() > 0.9
    assert np.nanquantile(np.abs(corrected - files), 0.98) < 3 * QUANTUM_M
    # Also of a body that turns meanwhile, or whose trajectory is another.
    for tables in ({"spin": {**SPIN, **SHIFT}}, {"spice": kernels(tmp_path, [0.3, 0.0, 0.0])}):
        both = {**tables, "spice": {**tables.get("spice", {}), "range_m": -1.15}}
        name = "-".join(tables)
        corrected = heights(tmp_path / f"{name}-ranges", found, **both)
        files = heights(tmp_path / f"{name}-files", [longer(s, -1.15) for s in found], **tables)
        assert np.isfinite(files).mean() > 0.9
        assert np.nanquantile(np.abs(corrected - files), 0.98) < 3 * QUANTUM_M


def test_scans_of_corrected_ranges_keep_stations_and_beams(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    settings = Settings().with_table("spice", range_m=0.4)
    locator = geolocator(workspace, settings.spin, settings.spice, max_gap_s=600.0)
    for scan in scans():
        moved, right = locator.located(scan)[0], longer(scan, 0.4)
        np.testing.assert_allclose(moved.points, right.points, atol=1e-9)
        np.testing.assert_array_equal(moved.range, right.range)
        np.testing.assert_allclose(moved.spacecraft, scan.spacecraft, atol=1e-9)
        np.testing.assert_allclose(moved.beam, scan.beam, atol=1e-12)
    timeless = replace(scan, time=np.full(len(scan), np.nan))
    assert dict(locator.located(timeless)[0].rejected) == {"no time": len(scan)}


def test_returns_are_found_where_longer_ranges_put_them(tmp_path: Path) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    for scan in scans():
        write_scan(workspace.root / "scans" / f"{scan.name}.h5", [scan])
    bare = Scan.of_points("bare", scan.points[:100], body="Ball")
    write_scan(workspace.root / "scans" / "bare.h5", [bare])
    settings = Settings().with_table("spice", range_m=25.0)
    store = located_store(workspace, settings.mapolas, settings.spin, settings.spice)
    assert store.without_place == {"bare": 100, "one": 0, "two": 0}
    right = np.concatenate([longer(scan, 25.0).points for scan in scans()])
    box = Box([35.0, 1.0, -1.0], np.eye(3), [10.0, 2.0, 2.0])
    found = store.returns_inside(box).points
    apart, _ = KDTree(right).query(found)
    assert apart.max() < 2 * QUANTUM_M
    assert len(found) == pytest.approx(np.count_nonzero(box.holds(right)), abs=3)
    assert len(found) > 1000


@pytest.mark.parametrize(
    ("table", "changed", "message"),
    [
        ("spice", {"spacecraft": ""}, "spacecraft and body"),
        ("spice", {"frame": "J2000"}, "reference"),
        ("spice", {"pupil_m": [0.0, 0.0, 1.0]}, "frame"),
        ("spice", {"mirror_scale": [0.0, 1e-3]}, "frame"),
        ("spin", {**SPIN, **SHIFT}, "rotation is that of the kernels"),
        ("mapolas", {"trajectory": "spc"}, "cannot both geolocate"),
    ],
)
def test_what_contradicts_kernels_is_refused(
    tmp_path: Path, table: str, changed: dict[str, object], message: str
) -> None:
    workspace = new_workspace(tmp_path / "ws", body="Ball")
    settings = Settings().with_table("spice", **kernels(tmp_path, [0.0, 0.0, 0.0]))
    settings = settings.with_table(table, **changed)
    with pytest.raises(SettingsError, match=message):
        located_store(workspace, settings.mapolas, settings.spin, settings.spice)


def test_kernels_through_the_command_line(tmp_path: Path) -> None:
    """Kernels stand in the workspace; one that is changed makes mapolas anew, one gone is named."""
    workspace = workspace_of(tmp_path / "ws", scans())
    table = kernels(workspace.root, [0.3, 0.0, 0.0])
    settings = Settings().with_table("mapolas", adjust=False)
    write_settings(
        workspace.root / SETTINGS_FILE,
        settings.with_table("spice", **{**table, "kernels": ["body.tpc", "craft.bsp"]}),
    )

    first = called("mapolas", workspace.root)
    assert first["summary"]["located_within_m"] < 5e-4
    height = workspace.mapola("AA0001").height
    assert called("mapolas", workspace.root)["state"] == "up to date"
    (workspace.root / "craft.bsp").unlink()
    assert "craft.bsp: is not a file" in refused("mapolas", workspace.root, "--json")
    kernels(workspace.root, [0.5, 0.0, 0.0])
    again = called("mapolas", workspace.root)
    assert again["state"] == "ran"
    rise = workspace.mapola("AA0001").height - height
    np.testing.assert_allclose(np.nanmedian(rise), 0.2, atol=QUANTUM_M)
