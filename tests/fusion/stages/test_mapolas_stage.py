"""The stages ingest and mapolas over a small workspace."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fusion.pipeline import Pipeline, Subset
from fusion.runtime import ThreadExecutor
from fusion.scene.geolocation.return_source import _MOST_ARCS, arc_length
from fusion.stages.ingest import stage as ingest
from fusion.stages.ingest.lidar_files import recorded_source
from fusion.stages.mapolas import stage as mapolas
from fusion.workspace import Workspace, new_workspace
from fusion.workspace.settings import Settings
from lidar.formats.native import scan_summary, write_scan
from lidar.gridding import Gridding, grid_returns
from lidar.scans import Scan
from spcola.errors import SettingsError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.grids import Maplet, MapletGrid
from spcola.shape import Mesh

GSD = 0.5
RADIUS = 60.0


def grid(longitude: float) -> MapletGrid:
    normal = np.array([np.cos(longitude), np.sin(longitude), 0.0])
    return MapletGrid.facing(RADIUS * normal, normal, GSD, 10)


def sphere_points(seed: int, count: int) -> np.ndarray[Any, Any]:
    """Random points on the sphere near the equator between longitudes −0.3 and 0.7."""
    generator = np.random.default_rng(seed)
    longitude, z = generator.uniform(-0.3, 0.7, count), generator.uniform(-0.25, 0.25, count)
    across = np.sqrt(1.0 - z**2)
    return RADIUS * np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """Three maplets, the last of them on the far side, and two scans over the first two."""
    made = new_workspace(tmp_path / "ws", body="Ball")
    for name, longitude in (("AA0001", 0.0), ("AA0002", 0.4), ("ZZ0001", 3.0)):
        flat = Maplet(name, grid(longitude), np.zeros(grid(longitude).shape))
        write_maplet(made.root / "MAPFILES" / f"{name}.MAP", flat)
    for seed, name in ((1, "one"), (2, "two")):
        scan = Scan.of_points(name, sphere_points(seed, 15_000), body="Ball")
        write_scan(made.root / "scans" / f"{name}.h5", [scan])
    return made


def pipeline(workspace: Workspace, settings: Settings | None = None) -> Pipeline:
    stages = [ingest.STAGE, mapolas.STAGE]
    return Pipeline(workspace, settings or Settings(), stages, ThreadExecutor(2))


def test_mapolas_are_made_where_maplets_and_returns_are(workspace: Workspace) -> None:
    run = pipeline(workspace).run_stage("mapolas")
    assert workspace.mapola_names() == ["AA0001", "AA0002"]
    assert (run.summary["grids"], run.summary["mapolas"]) == (3, 2)
    mapola = workspace.mapola("AA0001")
    x = GSD * mapola.grid.offsets
    sphere = np.sqrt(RADIUS**2 - np.add.outer(x**2, x**2)) - RADIUS
    assert mapola.coverage > 0.9
    # The median of a cell may err by the sphere's curvature over half a cell.
    np.testing.assert_allclose(mapola.height[mapola.valid], sphere[mapola.valid], atol=2e-3, rtol=0)
    assert set(mapola.scan_share) == {"one", "two"}
    assert sum(mapola.scan_share.values()) == pytest.approx(1.0)
    assert pipeline(workspace).run_stage("mapolas").state == "up to date"


def test_scans_put_there_by_hand_are_left_as_they_are(workspace: Workspace) -> None:
    before = {path: path.read_bytes() for path in workspace.scan_paths()}
    runs = pipeline(workspace).run()
    assert runs[0].summary["returns"] == 30_000
    assert {path: path.read_bytes() for path in workspace.scan_paths()} == before
    assert recorded_source(scan_summary(workspace.scan_path("one"))) is None


def test_spacing_and_size_can_be_chosen(workspace: Workspace) -> None:
    settings = Settings().with_table("mapolas", gsd_m=1.0, half_size=3)
    pipeline(workspace, settings).run_stage("mapolas")
    chosen = workspace.mapola("AA0001").grid
    assert (chosen.gsd, chosen.half_size) == (1.0, 3)


def test_thin_cells_get_no_height(workspace: Workspace) -> None:
    pipeline(workspace).run_stage("mapolas")
    before = workspace.mapola("AA0001")
    settings = Settings().with_table("mapolas", min_count=4)
    pipeline(workspace, settings).run_stage("mapolas")
    after = workspace.mapola("AA0001")
    assert after.valid.sum() < before.valid.sum()
    assert (after.count[after.valid] >= 4).all()


def test_a_taken_away_scan_makes_mapolas_again(workspace: Workspace) -> None:
    pipeline(workspace).run()
    workspace.scan_path("two").unlink()
    with pytest.raises(WorkspaceError, match=r"two\.h5, which stage ingest wrote, is gone"):
        pipeline(workspace).run()
    accepting = Settings.model_validate({"accept": {"codes": ["changed-input"]}})
    runs = pipeline(workspace, accepting).run()
    assert [run.state for run in runs] == ["ran", "ran"]
    assert set(workspace.mapola("AA0001").scan_share) == {"one"}


def test_returns_far_from_all_maplets_are_an_error(workspace: Workspace) -> None:
    for name in ("AA0001", "AA0002"):
        workspace.maplet_path(name).unlink()
    with pytest.raises(WorkspaceError, match="none of 1 grids"):
        pipeline(workspace).run_stage("mapolas")
    assert workspace.mapola_names() == []


def test_an_interrupt_leaves_no_mapolas_and_the_next_run_makes_them(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("fusion.scene.geolocation.return_source.grid_returns", interrupt)
        with pytest.raises(KeyboardInterrupt):
            pipeline(workspace).run_stage("mapolas")
    assert workspace.mapola_names() == []
    assert pipeline(workspace).run_stage("mapolas").state == "ran"
    assert workspace.mapola_names() == ["AA0001", "AA0002"]


def test_a_covering_needs_a_shape_and_a_spacing(workspace: Workspace) -> None:
    settings = Settings().with_table("mapolas", source="cover")
    with pytest.raises(WorkspaceError, match="needs a shape"):
        pipeline(workspace, settings).run_stage("mapolas")
    write_obj_mesh(workspace.root / "SHAPEFILES" / "ball.obj", ball())
    with pytest.raises(SettingsError, match=r"\[mapolas\] gsd_m"):
        pipeline(workspace, settings).run_stage("mapolas")


def test_a_covering_makes_mapolas_where_the_returns_are(workspace: Workspace) -> None:
    write_obj_mesh(workspace.root / "SHAPEFILES" / "ball.obj", ball())
    settings = Settings().with_table("mapolas", source="cover", gsd_m=1.0, half_size=6)
    run = pipeline(workspace, settings).run_stage("mapolas")
    assert 0 < run.summary["mapolas"] < run.summary["grids"]
    for name in workspace.mapola_names():
        known = workspace.mapola(name)
        radii = np.linalg.norm(known.points()[known.valid], axis=1)
        np.testing.assert_allclose(radii, RADIUS, atol=0.05, rtol=0)


def test_the_record_contains_what_mapolas_were_made_from(workspace: Workspace) -> None:
    pipeline(workspace).run_stage("mapolas")
    record = json.loads((workspace.root / "provenance" / "mapolas.json").read_text())
    assert set(record["inputs"]) == {
        "scans/one.h5",
        "scans/two.h5",
        "MAPFILES/AA0001.MAP",
        "MAPFILES/AA0002.MAP",
        "MAPFILES/ZZ0001.MAP",
    }
    assert set(record["outputs"]) == {
        "mapolas/AA0001.MAP",
        "mapolas/AA0002.MAP",
        "mapolas/adjustment.h5",
        "mapolas/mapolas.h5",
    }


def test_scans_are_adjusted_by_default(workspace: Workspace) -> None:
    run = pipeline(workspace).run_stage("mapolas")
    adjustment = workspace.adjustment()
    assert adjustment is not None
    assert adjustment.names == ("one", "two")
    assert [scan["scan"] for scan in run.summary["per_scan"]] == ["one", "two"]
    assert run.summary["suspect_scans"] == []
    settings = Settings().with_table("mapolas", adjust=False)
    plain = pipeline(workspace, settings).run_stage("mapolas")
    assert plain.state == "ran"
    assert workspace.adjustment() is None
    assert "per_scan" not in plain.summary


def ball() -> Mesh:
    """A sphere of RADIUS, by latitude and longitude."""
    bands, around = 24, 48
    latitude = np.linspace(-np.pi / 2, np.pi / 2, bands + 1)[1:-1]
    longitude = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    lat, lon = np.meshgrid(latitude, longitude, indexing="ij")
    rings = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    vertices = np.concatenate([rings.reshape(-1, 3), [[0, 0, -1.0], [0, 0, 1.0]]])
    south, north = len(vertices) - 2, len(vertices) - 1
    facets = []
    for i in range(around):
        j = (i + 1) % around
        for ring in range(bands - 2):
            a, b = ring * around, (ring + 1) * around
            facets += [[a + i, a + j, b + j], [a + i, b + j, b + i]]
        top = (bands - 2) * around
        facets += [[south, j, i], [top + i, top + j, north]]
    return Mesh(RADIUS * vertices, np.array(facets))


def wavy(longitude: np.ndarray[Any, Any], z: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Points of a sphere with hills."""
    across = np.sqrt(1.0 - z**2)
    radius = RADIUS + 0.5 * np.sin(25 * longitude) * np.cos(28 * z)
    away = np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)
    moved: np.ndarray[Any, Any] = radius[:, None] * away
    return moved


def test_a_long_track_is_moved_in_arcs_and_bends_rasters_less(workspace: Workspace) -> None:
    """It alone goes from raster to raster, and is too high in its middle."""
    for path in workspace.scan_paths():
        path.unlink()
    generator = np.random.default_rng(5)
    for number, start in enumerate((-0.2, 0.12, 0.44)):
        longitude = generator.uniform(start, start + 0.3, 40_000)
        points = wavy(longitude, generator.uniform(-0.12, 0.12, 40_000))
        raster = Scan.of_points(f"r{number}", points, time=np.full(40_000, 6.2e8), body="Ball")
        write_scan(workspace.root / "scans" / f"r{number}.h5", [raster])
    longitude = np.linspace(-0.2, 0.74, 40_000)
    way = wavy(longitude, generator.uniform(-0.05, 0.05, 40_000))
    lift = 0.2 * np.cos(3.0 * (longitude - 0.27))
    track = way * (1.0 + lift / RADIUS)[:, None]
    time = np.linspace(6.3e8, 6.3e8 + 2400.0, 40_000)
    write_scan(
        workspace.root / "scans" / "track.h5",
        [Scan.of_points("track", track, time=time, body="Ball")],
    )
    bent = []
    for arc_s, names in ((600.0, ["track:1", "track:2", "track:3", "track:4"]), (1e6, ["track"])):
        settings = Settings().with_table("mapolas", adjust_arc_s=arc_s)
        summary = pipeline(workspace, settings).run_stage("mapolas").summary
        adjustment = workspace.adjustment()
        assert adjustment is not None
        assert adjustment.names == ("r0", "r1", "r2", *names)
        assert [entry["scan"] for entry in summary["per_scan"]] == list(adjustment.names)
        assert set(workspace.mapola("AA0001").scan_share) <= set(adjustment.names)
        up = adjustment.center / np.linalg.norm(adjustment.center, axis=1)[:, None]
        lifted = np.einsum("si,si->s", adjustment.displacement[:, :3], up)
        bent.append(np.ptp(lifted[:3]))
    assert bent[0] < 0.6 * bent[1]


def test_arcs_are_longer_where_they_would_be_too_many(workspace: Workspace) -> None:
    """Their covariance is a full matrix."""
    time = np.linspace(0.0, 36_000.0, 15_000)
    track = Scan.of_points("track", sphere_points(1, 15_000), time=time, body="Ball")
    write_scan(workspace.root / "scans" / "track.h5", [track])
    table = Settings().mapolas
    assert arc_length(workspace, table) == table.adjust_arc_s
    short = Settings().with_table("mapolas", adjust_arc_s=10.0).mapolas
    arcs = 36_000.0 / arc_length(workspace, short)
    assert 0.8 * _MOST_ARCS < arcs <= _MOST_ARCS


def test_a_new_scan_grids_again_only_the_mapolas_that_it_touches(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    gridded: list[str] = []

    def counted(name: str, *arguments: Any, **options: Any) -> Gridding:
        gridded.append(name)
        return grid_returns(name, *arguments, **options)

    monkeypatch.setattr(mapolas, "grid_returns", counted)
    settings = Settings().with_table("mapolas", adjust=False)
    pipeline(workspace, settings).run()
    before = (workspace.home / "mapolas" / "AA0001.MAP").read_bytes()
    assert sorted(gridded) == ["AA0001", "AA0002", "ZZ0001"]
    points = sphere_points(3, 4000)
    # In the order of names it comes before the others: they get other numbers.
    east = Scan.of_points("new", points[points[:, 1] > 0.36 * RADIUS], body="Ball")
    write_scan(workspace.scan_path("new"), [east])
    gridded.clear()
    pipeline(workspace, settings).run()
    assert gridded == ["AA0002"]
    assert (workspace.home / "mapolas" / "AA0001.MAP").read_bytes() == before
    assert "new" in workspace.mapola("AA0002").scan_share
    together = {path.name: path.read_bytes() for path in workspace.mapola_paths()}
    shutil.rmtree(workspace.home / ".items")
    pipeline(workspace, settings).run_stage("mapolas", force=True)
    assert {path.name: path.read_bytes() for path in workspace.mapola_paths()} == together


def test_a_subset_leaves_the_others_as_they_are(workspace: Workspace) -> None:
    whole = pipeline(workspace)
    whole.run()
    before = {path.name: path.read_bytes() for path in workspace.mapola_paths()}
    coarse = Settings().with_table("mapolas", gsd_m=1.0, half_size=3)
    some = replace(pipeline(workspace, coarse), subset=Subset.of(["AA0002"]))
    assert some.run_stage("mapolas").summary["subset"] == {"only": ["AA0002"], "within": None}
    assert workspace.mapola("AA0002").grid.gsd == 1.0
    assert workspace.mapola("AA0001").grid.gsd == pytest.approx(GSD)
    assert whole.states()["mapolas"] == "due"
    whole.run()
    assert {path.name: path.read_bytes() for path in workspace.mapola_paths()} == before
