"""Solutions of a workspace: made, chosen, compared, exported and removed, through the commands."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import call

from fusion.pipeline.solutions import (
    MadeBy,
    lineage,
    making_solution,
    remove_solution,
    solutions_of,
)
from fusion.runtime import content_digest
from fusion.runtime.folders import LOCK_FILE, locked
from fusion.workspace import Workspace, new_workspace
from spcola.camera import Camera, SpcImage
from spcola.errors import WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid

BY = MadeBy("a test", {}, {}, {})


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


def test_files_of_other_solutions_have_names_of_their_own(workspace: Workspace) -> None:
    one, other = (replace(workspace, solution=name) for name in ("one", "other"))
    names = {one.relative(each.maplet_path("AA0001")) for each in (workspace, one, other)}
    assert names == {
        "MAPFILES/AA0001.MAP", "../../MAPFILES/AA0001.MAP", "../other/MAPFILES/AA0001.MAP",
    }  # fmt: skip
    for each in (workspace, one, other):
        path = each.maplet_path("AA0001")
        assert one.path_of(one.relative(path)).resolve() == path.resolve()
    # All solutions share the pixels.
    assert one.relative(one.exposure_path("I0")) == "IMAGEFILES/I0.DAT"


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
    listed = call("solution", "list", root).stdout.splitlines()
    assert [line.split(" (")[0] for line in listed[:-1]] == [
        "* imported", "    one", "      two", "    three",
    ]  # fmt: skip
    assert call("solution", "use", root, "two").stdout == "in use: two\n"
    assert Workspace.open(root).home == grandchild.home
    assert json.loads(call("info", root, "--json").stdout)["solution"] == "two"
    shown = json.loads(call("solution", "show", root, "two", "--json").stdout)
    assert (shown["parent"], shown["made_by"], shown["maplets"]) == ("one", "a test", 2)
    found = json.loads(call("solution", "diff", root, "one", "two", "--json").stdout)
    assert found["centers_outward_m"]["p100"] == pytest.approx(0.2, abs=1e-3)
    assert found["centers_outward_m"]["p50"] == pytest.approx(0.1, abs=1e-3)
    assert found["heights_changed_m"]["p100"] < 1e-3


def test_what_is_in_use_or_has_children_is_not_removed(workspace: Workspace) -> None:
    root = workspace.root
    made(made(workspace, "one"), "two")
    call("solution", "use", root, "two")
    for name, why in (("imported", "cannot be removed"), ("two", "in use"), ("one", "two was")):
        assert why in call("solution", "remove", root, name, code=1).stderr
    call("solution", "use", root, "imported")
    for name in ("two", "one"):
        call("solution", "remove", root, name)
    assert [one.name for one in solutions_of(workspace).sound()] == ["imported"]
    for command in (("use", root, "one"), ("show", root, "one"), ("diff", root, "one", "two")):
        error = call("solution", *command, code=1).stderr
        assert "there is no solution 'one'" in error
        assert "there are: imported" in error


class KilledError(BaseException):
    """Stands for the end of a process at one place."""


@pytest.mark.parametrize("at", ["rename", "rmtree", "the end"])
def test_a_job_that_was_killed_in_a_removal_ends_it_and_no_other_does(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    def killed(*_: Any, **__: Any) -> None:
        raise KilledError

    made(workspace, "one")
    with monkeypatch.context() as patch:
        if at == "the end":
            remove_solution(workspace, "one", job="first")
        else:
            patch.setattr(*{"rename": (Path, "rename"), "rmtree": (shutil, "rmtree")}[at], killed)
            with pytest.raises(KilledError):
                remove_solution(workspace, "one", job="first")
    gone = at != "rename"
    assert (workspace.root / "solutions" / "one").exists() != gone
    if gone:
        for other in ("", "second"):
            with pytest.raises(WorkspaceError, match="there is no solution 'one'"):
                remove_solution(workspace, "one", job=other)
    remove_solution(workspace, "one", job="first")
    folder = workspace.root / "solutions"
    assert {path.name for path in folder.iterdir()} == {".lock", ".removed.json"}
    # A later one of the name is not what the job was to remove.
    made(workspace, "one", 0.2)
    remove_solution(workspace, "one", job="first")
    assert (folder / "one").is_dir()
    remove_solution(workspace, "one", job="second")
    assert not (folder / "one").exists()


def forge(workspace: Workspace, of: str, checksum: str = "right", **changed: Any) -> None:
    """Change the record of a solution, as a bad disk, an editor or another program would."""
    path = workspace.root / "solutions" / of / "solution.json"
    content = {**json.loads(path.read_text()), **changed}
    old = content.pop("checksum")
    found = {"right": content_digest(content), "old": old, "none": ""}[checksum]
    path.write_text(json.dumps({**content, "checksum": found}))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"constants": {"boddy": {"name": "x"}}}, "[boddy]: is an unknown table"),
        ({"constants": {"body": {"radius": 1}}}, "[body] radius: is an unknown key"),
        ({"constants": {"body": {"mean_radius_m": -5}}}, "[body] mean_radius_m: should be 0, or"),
        ({"constants": 7}, "constants: should be an object"),
        ({"parent": None}, "parent: should be a valid string"),
        ({"name": "two"}, "is the record of the solution 'two'"),
        ({"checksum": "old", "facts": {"epsilon": 1e-3}}, "fails its checksum"),
        ({"checksum": "none"}, "fails its checksum"),
    ],
)
def test_a_damaged_record_is_refused_by_file_and_key_and_can_be_removed(
    workspace: Workspace, changed: dict[str, Any], words: str
) -> None:
    root = workspace.root
    made(workspace, "one")
    forge(workspace, "one", **changed)
    for command in (("use",), ("show",), ("diff", "imported")):
        error = call("solution", command[0], root, *command[1:], "one", code=1).stderr
        assert words in error
        assert "solutions/one/solution.json" in error
        assert error.count("\n") == 1
    assert call("info", root, "--json").stdout
    assert words in call("solution", "list", root).stdout
    call("solution", "remove", root, "one")
    assert len(solutions_of(workspace).sound()) == 1


def test_parents_that_are_gone_or_form_a_circle_are_refused(workspace: Workspace) -> None:
    two = made(made(workspace, "one"), "two")
    assert [one.name for one in lineage(two)] == ["two", "one", "imported"]
    forge(workspace, "one", parent="two")
    with pytest.raises(WorkspaceError, match="circle"):
        lineage(two)
    with pytest.raises(WorkspaceError, match="the parents of one, two form a circle"):
        solutions_of(workspace).sound()
    shutil.rmtree(workspace.root / "solutions" / "one")
    with pytest.raises(WorkspaceError, match="'one' is gone"):
        lineage(two)


def test_names_are_checked(workspace: Workspace) -> None:
    for name in ("", "imported", "All", "../x", ".x", "a b", "in_use", "x" * 41, "ä"):
        with pytest.raises(WorkspaceError, match=r"solution|taken"):
            made(workspace, name)
    made(workspace, "one")
    with pytest.raises(WorkspaceError, match="a solution 'one' already"):
        made(workspace, "one")


def test_an_exported_solution_is_a_workspace_with_the_same_numbers(
    workspace: Workspace, tmp_path: Path
) -> None:
    root, constants = workspace.root, {"spin": {"meridian_deg": 45.61}}
    (root / "IMAGEFILES" / "P1.DAT").write_bytes(b"pixels")
    toml = (root / "spcola.toml").read_text()
    toml = toml.replace('name = "body"', 'name = "Bennu"').replace(
        "mean_radius_m = 0.0", "mean_radius_m = 245.1"
    )
    (root / "spcola.toml").write_text(toml)
    with making_solution(workspace, "one", MadeBy("a test", constants, {}, {})) as folder:
        write_maplet(folder / "MAPFILES" / "AA0001.MAP", maplet("AA0001", 0.1))
    new, out = Workspace.open(root, "one"), tmp_path / "out"
    written = json.loads(call("solution", "export", root, "one", out, "--json").stdout)["written"]
    assert (written["MAPFILES"], written["IMAGEFILES"]) == (2, 1)
    call("init", tmp_path / "again", "--spc", out)
    again = Workspace.open(tmp_path / "again")
    for name in ("AA0001", "AA0002"):
        assert again.maplet_path(name).read_bytes() == new.maplet_path(name).read_bytes()
    assert again.exposure_path("P1").read_bytes() == b"pixels"
    assert again.settings() == new.settings()
    for place, why in ((out, "exists already"), (root / "MAPFILES" / "x", "lies in the workspace")):
        assert why in call("solution", "export", root, "one", place, code=1).stderr


def test_readers_and_other_solutions_do_not_wait_for_a_writer(workspace: Workspace) -> None:
    root = workspace.root
    made(workspace, "one")
    with locked(root / LOCK_FILE):
        assert json.loads(call("info", root, "--json").stdout)["maplets"] == 2
        call("solution", "diff", root, "imported", "one")
        assert "another spcola is at work" in call("fuse", root, code=1).stderr
        # The other solution can be worked with: what it lacks is named, and not the lock.
        other = call("fuse", root, "--solution", "one", code=1).stderr
        assert "there is no registration" in other


def test_a_failure_while_one_is_made_leaves_none(workspace: Workspace) -> None:
    with pytest.raises(RuntimeError), making_solution(workspace, "one", BY):
        raise RuntimeError
    assert [path.name for path in (workspace.root / "solutions").iterdir()] == [".lock"]


KILLED = """
import sys, time
from pathlib import Path
from typing import Any
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
        with pytest.raises(WorkspaceError, match="another spcola is making"):
            made(workspace, "one")
        # Others are made meanwhile, but what one is made from is not removed.
        made(workspace, "two")
        os.kill(process.pid, signal.SIGKILL)
    assert [one.name for one in solutions_of(workspace).sound()] == ["imported", "two"]
    made(workspace, "one")
    names = {path.name for path in (workspace.root / "solutions").iterdir()}
    assert names == {"one", "two", ".lock"}


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
    found = json.loads(call("solution", "diff", root, "imported", "moved", "--json").stdout)
    assert found["cameras_changed_px"]["p100"] == pytest.approx(np.sqrt(2.0), abs=1e-6)
    assert found["positions_moved_m"]["p100"] == pytest.approx(1e4)
    out = tmp_path / "out"
    (written,) = json.loads(call("solution", "export", root, "kept", out, "--json").stdout)[
        "cameras"
    ]
    assert written["file"] == camera_file.name
    assert 0.01 < written["rms_px"] < written["largest_px"] < 0.5
    assert (out / "SUMFILES" / camera_file.name).read_bytes() == camera_file.read_bytes()
    camera_file.unlink()
    error = call("solution", "export", root, "imported", tmp_path / "none", code=1).stderr
    assert "which is not there" in error
    assert not (tmp_path / "none").exists()
