"""Workspaces: made of nothing, of a shape, over an SPC folder; what is listed and read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fusion.runtime import json_text
from fusion.workspace import OWN_FOLDERS, SPC_FOLDERS, Workspace, new_workspace
from fusion.workspace.settings import Settings
from spcola.errors import FormatError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.shapes import write_obj_mesh
from spcola.formats.solution import write_list
from spcola.grids import Maplet, MapletGrid
from spcola.shape import Mesh

TETRAHEDRON = Mesh(
    100.0 * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]),
    np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]),
)


def maplet(name: str) -> Maplet:
    grid = MapletGrid.facing([100.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0, 4)
    return Maplet(name, grid, np.add.outer(0.1 * grid.offsets, 0.2 * grid.offsets))


@pytest.fixture
def spc(tmp_path: Path) -> Path:
    """An SPC working folder with two maplets."""
    folder = tmp_path / "spc"
    (folder / "MAPFILES").mkdir(parents=True)
    (folder / "SUMFILES").mkdir()
    for name in ("AA0002", "AA0001"):
        write_maplet(folder / "MAPFILES" / f"{name}.MAP", maplet(name))
    return folder


def test_a_new_workspace_has_its_folders_and_settings(tmp_path: Path) -> None:
    made = new_workspace(tmp_path / "ws", body="Bennu")
    assert {p.name for p in made.root.iterdir()} == {*SPC_FOLDERS, *OWN_FOLDERS, "spcola.toml"}
    assert Workspace.open(made.root).settings().body.name == "Bennu"
    assert made.maplet_names() == made.scan_names() == made.mapola_names() == []


def test_a_workspace_is_not_made_twice(tmp_path: Path) -> None:
    new_workspace(tmp_path / "ws")
    with pytest.raises(WorkspaceError, match="is a workspace already"):
        new_workspace(tmp_path / "ws")


def test_what_is_no_workspace_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match="spcola init"):
        Workspace.open(tmp_path)
    with pytest.raises(WorkspaceError, match="is not a folder"):
        Workspace.open(tmp_path / "nowhere")


def test_a_workspace_cannot_be_made_where_a_file_is(tmp_path: Path) -> None:
    (tmp_path / "ws").write_text("a file")
    with pytest.raises(WorkspaceError, match="cannot be created"):
        new_workspace(tmp_path / "ws")


def test_files_of_an_spc_folder_are_linked(tmp_path: Path, spc: Path) -> None:
    made = new_workspace(tmp_path / "ws", spc=spc)
    assert made.maplet_names() == ["AA0001", "AA0002"]
    assert (made.root / "MAPFILES" / "AA0001.MAP").is_symlink()
    np.testing.assert_allclose(
        made.maplet("AA0001").height, maplet("AA0001").height, atol=1e-3, rtol=0
    )


def test_an_spc_folder_can_be_the_workspace_itself(spc: Path) -> None:
    before = {p: p.read_bytes() for p in (spc / "MAPFILES").iterdir()}
    made = new_workspace(spc, spc=spc)
    assert made.maplet_names() == ["AA0001", "AA0002"]
    assert {p: p.read_bytes() for p in (spc / "MAPFILES").iterdir()} == before
    assert not any(p.is_symlink() for p in before)


def test_a_folder_without_spc_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(WorkspaceError, match="no SPC working folder"):
        new_workspace(tmp_path / "ws", spc=tmp_path / "empty")
    assert not (tmp_path / "ws").exists()


def test_lists_determine_which_maplets_are_used(spc: Path) -> None:
    write_list(spc / "LMRKLIST.TXT", ["AA0002"])
    made = new_workspace(spc)
    assert made.maplet_names() == made.landmark_names() == ["AA0002"]
    write_list(spc / "MAPLIST.TXT", ["AA0001"])
    assert made.maplet_names() == ["AA0001"]


def test_a_listed_maplet_that_is_not_there_is_named(spc: Path) -> None:
    write_list(spc / "MAPLIST.TXT", ["AA0009"])
    with pytest.raises(WorkspaceError, match=r"AA0009\.MAP: the maplet is not there"):
        new_workspace(spc).maplet("AA0009")


def test_a_shape_is_copied_and_read_in_its_unit(tmp_path: Path) -> None:
    write_obj_mesh(tmp_path / "shape.obj", TETRAHEDRON, unit="m")
    made = new_workspace(tmp_path / "ws", shape=tmp_path / "shape.obj", shape_unit="m")
    np.testing.assert_allclose(made.shape().vertices, TETRAHEDRON.vertices, rtol=1e-6)
    (tmp_path / "shape.obj").unlink()
    assert made.has_shape()


def test_a_file_that_is_no_shape_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "shape.obj").write_text("this is no shape\n")
    with pytest.raises(FormatError):
        new_workspace(tmp_path / "ws", shape=tmp_path / "shape.obj")
    assert not (tmp_path / "ws").exists()


def test_of_several_shapes_one_has_to_be_chosen(tmp_path: Path) -> None:
    made = new_workspace(tmp_path / "ws")
    with pytest.raises(WorkspaceError, match="holds no shape"):
        made.shape_path()
    for name in ("a.obj", "b.obj"):
        write_obj_mesh(made.root / "SHAPEFILES" / name, TETRAHEDRON)
    with pytest.raises(WorkspaceError, match=r"several shapes \(a.obj, b.obj\).*\[body\] shape"):
        made.shape_path()
    text = (made.root / "spcola.toml").read_text()
    (made.root / "spcola.toml").write_text(text.replace('shape = ""', 'shape = "b.obj"'))
    assert made.shape_path().name == "b.obj"


def test_json_is_sorted_and_knows_unknown(tmp_path: Path) -> None:
    made = Workspace.create(tmp_path / "ws", Settings())
    content = {"b": np.nan, "a": [np.float32(1.5), np.int64(2)], "c": {"inf": float("inf")}}
    path = made.write_json("x.json", {**content, "array": np.array([[1.0, np.nan]])})
    assert list(json.loads(path.read_text())) == ["a", "array", "b", "c"]
    assert made.read_json("x.json") == {
        "a": [1.5, 2],
        "array": [[1.0, None]],
        "b": None,
        "c": {"inf": None},
    }
    assert json_text({"µ": 1}) == '{\n  "µ": 1\n}\n'


@pytest.mark.parametrize("text", ["{", "[1]", ""])
def test_what_is_no_json_object_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    made = Workspace.create(tmp_path / "ws", Settings())
    (made.root / "scale.json").write_text(text)
    with pytest.raises(WorkspaceError, match=r"scale\.json"):
        made.read_json("scale.json")
