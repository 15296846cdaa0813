"""The search for the lidar's frame in a workspace, with lidar files that were made wrong."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from command_line import call
from scipy.spatial import ConvexHull

from fusion.runtime import ThreadExecutor
from fusion.stages import import_scans
from fusion.stages.register.frame_search import search_workspace_frames, surface_points
from fusion.truth import make_mission
from fusion.truth.generation import LIDAR_FOLDER, SPC_FOLDER
from fusion.truth.presets import MissionSettings
from fusion.workspace import Workspace, new_workspace
from lidar.formats.missions import write_ola
from lidar.formats.missions.ola import read_ola
from lidar.formats.native import write_scan
from lidar.formats.records import LidarOptions
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.grids import Maplet, MapletGrid
from spcola.math import lattice
from spcola.shape import Mesh

BENCH = Path(__file__).resolve().parents[3] / "scripts" / "bench"
RADIUS = 40.0


def ground(directions: FloatArray) -> FloatArray:
    """Points (N, 3), metres, of a lumpy body."""
    draw = np.random.default_rng(1)
    wave = draw.normal(size=(60, 3))
    wave *= (np.geomspace(2.0, 20.0, 60) / np.linalg.norm(wave, axis=1))[:, None]
    heights = np.cos(directions @ wave.T + draw.uniform(0.0, 6.0, 60)) @ np.geomspace(
        0.02, 5e-3, 60
    )
    points: FloatArray = RADIUS * (1.0 + heights)[:, None] * directions
    return points


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """A workspace with a shape, and a scan of the same body turned by 120° about Z."""
    units = lattice(8000)
    facets = ConvexHull(units).simplices.astype(np.int64)
    a, b, c = units[facets].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    facets[inward] = facets[inward][:, ::-1]
    write_obj_mesh(tmp_path / "body.obj", Mesh(ground(units), facets), unit="m")
    workspace = new_workspace(tmp_path / "WS", shape=tmp_path / "body.obj", shape_unit="m")
    turn = np.array([[-0.5, -np.sqrt(0.75), 0.0], [np.sqrt(0.75), -0.5, 0.0], [0.0, 0.0, 1.0]])
    seen = ground(lattice(20_001)) @ turn.T
    write_scan(workspace.scan_path("one"), [Scan.of_points("one", seen)])
    return workspace


def test_returns_are_searched_against_the_shape(workspace: Workspace) -> None:
    search = search_workspace_frames(workspace, workspace.settings())
    assert search.found
    assert search.text == "the lidar fits when turned by −120.0° about Z"
    assert search.as_json()["candidates"][0]["angle_deg"] == pytest.approx(-120.0, abs=0.1)


def test_maplets_stand_for_the_shape_where_they_are(workspace: Workspace) -> None:
    grid = MapletGrid.facing([RADIUS + 3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.5, 20)
    write_maplet(workspace.root / "MAPFILES" / "AA0001.MAP", Maplet("AA0001", grid, None))  # type: ignore[arg-type]
    points = surface_points(workspace, workspace.settings())
    near = points[(np.abs(points[:, 1:]) < 8.0).all(axis=1) & (points[:, 0] > 0.0)]
    np.testing.assert_allclose(near[:, 0], RADIUS + 3.0, atol=1e-3)
    assert (points[:, 0] < 0.0).any()
    only = workspace.settings().with_table("register", against="shape")
    assert np.abs(surface_points(workspace, only)).max() < RADIUS * 1.5
    assert not np.isclose(surface_points(workspace, only)[:, 0], RADIUS + 3.0, atol=1e-6).any()


@pytest.fixture(scope="module")
def alter() -> ModuleType:
    spec = importlib.util.spec_from_file_location("alter", BENCH / "wrong" / "alter.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look for their module by its name.
    sys.modules["alter"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "how",
    [
        "turn 37 random", "mirror x", "west", "axes yzx", "unit 0.001", "scale 1.05", "shift 1 2 3",
        "cloud", "shuffle", "times", "clock 5", "other", "sphere", "relief", "noise 0.1", "bias 1",
        "drift 2", "outliers 0.2", "half", "one turn 20 z", "none",
    ],
)  # fmt: skip
def test_altered_files_agree_with_themselves(tmp_path: Path, alter: ModuleType, how: str) -> None:
    time = 6.0e8 + np.arange(200.0)
    points = ground(lattice(200))
    spacecraft = 100.0 * lattice(200)
    scan = Scan.of_points("a", points, time=time, spacecraft=spacecraft)
    (tmp_path / "in").mkdir()
    write_ola(tmp_path / "in" / "a.dat", [scan])
    (path,) = alter.alter(tmp_path / "in", tmp_path / "out", how)
    read = list(read_ola(path, LidarOptions(reference_offset_m=0.0, range_tolerance_m=1e-3)))
    count = sum(len(chunk) for chunk in read)
    assert count == (100 if how == "half" else 200)
    changed = count != 200 or not (
        np.allclose(read[0].points, points, atol=1e-6) and np.array_equal(read[0].time, time)
    )
    assert changed == (how != "none")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("tiny") / "mission"
    make_mission(root, settings=MissionSettings.tiny(3))
    return root


@pytest.fixture(scope="module")
def imported(
    tiny: Path, alter: ModuleType, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Workspace]:
    def make(how: str) -> Workspace:
        root = tmp_path_factory.mktemp("altered")
        paths = alter.alter(tiny / LIDAR_FOLDER, root / "lidar", how)
        workspace = new_workspace(root / "WS", spc=tiny / SPC_FOLDER)
        import_scans(workspace, paths, executor=ThreadExecutor(1))
        return workspace

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "text"),
    [
        ("none", "the lidar fits as it is"),
        ("turn 90 z", "the lidar fits when turned by −90.0° about Z"),
        ("turn 2.9 z", "the lidar fits when turned by −2.9° about Z"),
        ("mirror x", "the lidar fits when mirrored in X"),
        ("west", "the lidar fits when mirrored in Y (longitudes of the other sign)"),
        ("one turn 90 z", "the lidar fits as it is"),
        ("cloud", "no rotation"),
        ("shuffle", "no rotation"),
        ("other", "no rotation"),
        ("sphere", "no rotation"),
        ("relief", "no rotation"),
    ],
)
def test_files_of_a_mission_made_wrong(
    imported: Callable[[str], Workspace], how: str, text: str
) -> None:
    workspace = imported(how)
    search = search_workspace_frames(workspace, workspace.settings())
    assert search.text.startswith(text)
    assert search.found != (text == "no rotation")


@pytest.mark.parametrize(
    ("how", "text"),
    [
        ("turn 90 z", "the lidar fits when turned by −90.0° about Z"),
        pytest.param("mirror x", "the lidar fits when mirrored in X", marks=pytest.mark.slow),
    ],
)
def test_register_refuses_lidar_of_another_frame_and_names_it(
    imported: Callable[[str], Workspace], how: str, text: str
) -> None:
    root = imported(how).root
    settings = root / "spcola.toml"
    # Scans that are not adjusted take a quarter of the time, and lie in the wrong frame alike.
    settings.write_text(settings.read_text().replace("adjust = true", "adjust = false"))
    call("mapolas", root)
    result = call("register", root, code=1)
    assert f"{text} [fits-otherwise]" in result.stderr
    assert f"note: {text} [fits-otherwise]" in result.stdout
    content = json.loads((root / "registration.json").read_text())
    assert content["verdict"] == "refused"
    assert [one["text"] for one in content["findings"] if one["code"] == "fits-otherwise"] == [text]
    assert content["frame_search"]["found"] is True
    estimate = content["refused_estimate"]
    for key in ("scale", "rotation_deg", "translation_m", "covariance", "inverse"):
        assert content[key] is None
        assert estimate[key] is not None
    refusal = call("fuse", root, "--accept", "fits-otherwise", code=1).stderr
    assert text in refusal
    assert "refused" in refusal
    assert not any((root / "fused").iterdir())
