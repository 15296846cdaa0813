"""Solutions of a workspace: made, chosen, compared, exported and removed, through the commands."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fusion.cli.app import app
from fusion.pipeline.pipeline import LOCK_FILE
from fusion.pipeline.solutions import MadeBy, making_solution, solutions_of
from fusion.runtime.folders import locked
from fusion.workspace import Workspace, new_workspace
from spcola.camera import Camera, SpcImage
from spcola.errors import WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid

BY = MadeBy("a test", {}, {}, {})


def run(*arguments: object, code: int = 0) -> Any:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


def maplet(name: str, up: float = 0.0) -> Maplet:
    away = np.array([0.6, 0.0, 0.8]) if name == "AA0001" else np.array([0.0, 1.0, 0.0])
    grid = MapletGrid.facing((250.0 + up) * away, away, 0.5, 4)
    return Maplet(name, grid, np.arange(81.0).reshape(9, 9) / 50.0)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    spc = tmp_path / "spc"
    (spc / "MAPFILES").mkdir(parents=True)
    for name in ("AA0001", "AA0002"):
        write_maplet(spc / "MAPFILES" / f"{name}.MAP", maplet(name))
    return new_workspace(tmp_path / "WS", spc=spc)


def made(workspace: Workspace, name: str, up: float = 0.1) -> Workspace:
    """Make a solution in which one maplet lies higher."""
    with making_solution(workspace, name, BY) as folder:
        write_maplet(folder / "MAPFILES" / "AA0001.MAP", maplet("AA0001", up))
    return Workspace.open(workspace.root, name)


def test_a_solution_holds_what_changed_and_shares_the_rest(workspace: Workspace) -> None:
    before = workspace.maplet_path("AA0001").read_bytes()
    new = made(workspace, "higher")
    assert workspace.maplet_path("AA0001").read_bytes() == before
    moved = new.maplet("AA0001").grid.center - workspace.maplet("AA0001").grid.center
    np.testing.assert_allclose(moved, [0.06, 0.0, 0.08], atol=1e-4)
    assert new.maplet_path("AA0002").samefile(workspace.maplet_path("AA0002"))
    # Writing one of the shared files anew leaves that of the parent.
    write_maplet(new.maplet_path("AA0002"), maplet("AA0002", 5.0))
    assert not new.maplet_path("AA0002").samefile(workspace.maplet_path("AA0002"))


def test_settings_of_a_solution_hold_in_it_alone(workspace: Workspace) -> None:
    constants = {"spin": {"meridian_deg": 45.61}}
    with making_solution(workspace, "spun", MadeBy("a test", constants, {}, {})):
        pass
    assert Workspace.open(workspace.root, "spun").settings().spin.meridian_deg == 45.61
    assert workspace.settings().spin.meridian_deg == 0.0


def test_the_commands_list_use_show_and_compare(workspace: Workspace) -> None:
    root = workspace.root
    grandchild = made(made(workspace, "one"), "two", 0.3)
    made(workspace, "three")
    listed = run("solution", "list", root).stdout.splitlines()
    assert [line.split(" (")[0] for line in listed[:-1]] == [
        "* imported", "    one", "      two", "    three",
    ]  # fmt: skip
    assert run("solution", "use", root, "two").stdout == "in use: two\n"
    assert Workspace.open(root).home == grandchild.home
    assert json.loads(run("info", root, "--json").stdout)["solution"] == "two"
    shown = json.loads(run("solution", "show", root, "two", "--json").stdout)
    assert (shown["parent"], shown["made_by"], shown["maplets"]) == ("one", "a test", 2)
    found = json.loads(run("solution", "diff", root, "one", "two", "--json").stdout)
    assert found["centers_outward_m"]["p100"] == pytest.approx(0.2, abs=1e-3)
    assert found["centers_outward_m"]["p50"] == pytest.approx(0.1, abs=1e-3)
    assert found["heights_changed_m"]["p100"] < 1e-3


def test_what_is_in_use_or_has_children_is_not_removed(workspace: Workspace) -> None:
    root = workspace.root
    made(made(workspace, "one"), "two")
    run("solution", "use", root, "two")
    for name, why in (("imported", "cannot be removed"), ("two", "in use"), ("one", "two was")):
        assert why in run("solution", "remove", root, name, code=1).stderr
    run("solution", "use", root, "imported")
    for name in ("two", "one"):
        run("solution", "remove", root, name)
    assert [one.name for one in solutions_of(workspace)] == ["imported"]
    for command in (("use", root, "one"), ("show", root, "one"), ("diff", root, "one", "two")):
        error = run("solution", *command, code=1).stderr
        assert "there is no solution 'one'" in error
        assert "there are: imported" in error


def test_names_are_checked(workspace: Workspace) -> None:
    for name in ("", "imported", "all", "../x", ".x", "a b", "IN_USE", "x" * 41, "ä"):
        with pytest.raises(WorkspaceError, match=r"solution|taken"):
            made(workspace, name)
    made(workspace, "one")
    with pytest.raises(WorkspaceError, match="a solution 'one' already"):
        made(workspace, "one")


def test_export_writes_a_plain_folder_that_a_workspace_can_be_made_of(
    workspace: Workspace, tmp_path: Path
) -> None:
    new = made(workspace, "one")
    written = run("solution", "export", workspace.root, "one", tmp_path / "out", "--json").stdout
    assert json.loads(written)["written"]["MAPFILES"] == 2
    again = new_workspace(tmp_path / "again", spc=tmp_path / "out")
    for name in ("AA0001", "AA0002"):
        assert again.maplet_path(name).read_bytes() == new.maplet_path(name).read_bytes()
    error = run("solution", "export", workspace.root, "one", tmp_path / "out", code=1).stderr
    assert "exists already" in error


def test_readers_and_other_solutions_do_not_wait_for_a_writer(workspace: Workspace) -> None:
    root = workspace.root
    made(workspace, "one")
    with locked(root / LOCK_FILE):
        assert json.loads(run("info", root, "--json").stdout)["maplets"] == 2
        run("solution", "diff", root, "imported", "one")
        assert "another spcola is at work" in run("fuse", root, code=1).stderr
        # The other solution can be worked with: what it lacks is named, and not the lock.
        other = run("fuse", root, "--solution", "one", code=1).stderr
        assert "there is no registration" in other


def test_a_failure_while_one_is_made_leaves_none(workspace: Workspace) -> None:
    with pytest.raises(RuntimeError), making_solution(workspace, "one", BY):
        raise RuntimeError
    assert [path.name for path in (workspace.root / "solutions").iterdir()] == [".lock"]


KILLED = """
import sys, time
from pathlib import Path
from fusion.pipeline.pipeline import LOCK_FILE
from fusion.pipeline.solutions import MadeBy, making_solution
from fusion.workspace import Workspace
with making_solution(Workspace.open(sys.argv[1]), "one", MadeBy("a test", {}, {}, {})) as folder:
    (folder / "MAPFILES" / "half.MAP").write_bytes(b"half")
    print("begun", flush=True)
    time.sleep(60)
"""


def test_a_crash_while_one_is_made_leaves_none(workspace: Workspace) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(workspace.root)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        with pytest.raises(WorkspaceError, match="another spcola is at work"):
            made(workspace, "two")
        os.kill(process.pid, signal.SIGKILL)
    assert [one.name for one in solutions_of(workspace)] == ["imported"]
    made(workspace, "one")
    names = {path.name for path in (workspace.root / "solutions").iterdir()}
    assert names == {"one", ".lock"}


def test_an_exact_camera_goes_with_its_images(workspace: Workspace, tmp_path: Path) -> None:
    # Brown's third radial term has no place in a .SUM file.
    lens = Camera(150.0, [512.5, 512.5], [[71.4, 0, 0], [0, 71.4, 0]], 1024, 1024, "brown",
                  [-0.2, 0.5, 1e-3, -2e-3, 0.1])  # fmt: skip
    image = SpcImage("P1", "2019-03-03", lens, [0, 0, 1e5], np.eye(3), [1.0, 0, 0])
    write_summary(workspace.image_path("P1"), image)
    (camera_file,) = (workspace.root / "SUMFILES").glob("CAMERA-*.toml")
    assert workspace.state_files() == [workspace.image_path("P1"), camera_file]
    with making_solution(workspace, "moved", BY) as folder:
        nearer = replace(image, camera=replace(lens, center=lens.center + 1.0), scobj=[0, 0, 9e4])
        write_summary(folder / "SUMFILES" / "P1.SUM", nearer)
    with making_solution(workspace, "kept", BY) as folder:
        write_summary(
            folder / "SUMFILES" / "P1.SUM", replace(image, scobj=[0, 0, 8e4]),
            like=workspace.image_path("P1"),
        )  # fmt: skip
    root, kept = workspace.root, Workspace.open(workspace.root, "kept")
    assert (kept.home / "SUMFILES" / camera_file.name).samefile(camera_file)
    assert kept.image("P1").camera.distortion_model == "brown"
    found = json.loads(run("solution", "diff", root, "imported", "moved", "--json").stdout)
    assert found["cameras_changed_px"]["p100"] == pytest.approx(np.sqrt(2.0), abs=1e-6)
    assert found["positions_moved_m"]["p100"] == pytest.approx(1e4)
    out = tmp_path / "out"
    (written,) = json.loads(run("solution", "export", root, "kept", out, "--json").stdout)[
        "cameras"
    ]
    assert written["file"] == camera_file.name
    assert 0.01 < written["rms_px"] < written["largest_px"] < 0.5
    assert (out / "SUMFILES" / camera_file.name).read_bytes() == camera_file.read_bytes()
    camera_file.unlink()
    error = run("solution", "export", root, "imported", tmp_path / "none", code=1).stderr
    assert "which is not there" in error
    assert not (tmp_path / "none").exists()
