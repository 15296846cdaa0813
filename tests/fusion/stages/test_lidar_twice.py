"""Maplets that contain the lidar are not compared or fused with it again, unless that is accepted.

Through the real command line on a small synthetic mission.
"""

from __future__ import annotations

import shutil

import pytest
from command_line import call, called, refused

from fusion.pipeline import Pipeline
from fusion.stages import load_stages
from fusion.workspace import Workspace

NAME = "TR0009"
CODE = "lidar-counted-twice"
ACCEPTED = ("--accept", CODE)
BOTH = ("--solution", "both")


@pytest.fixture(scope="module")
def root(imaged_mission, tmp_path_factory):
    """A copy with a maplet that images and lidar determine, and one that images alone do."""
    root = tmp_path_factory.mktemp("twice") / "WS"
    shutil.copytree(imaged_mission[0], root, symlinks=True)
    shutil.rmtree(root / "solutions", ignore_errors=True)
    call("fuse", root, "--from", "images", "--only", NAME, "--as", "both")
    call("spc", "lithos", root, "--only", NAME, "--start", "shape", "--as", "images")
    call("mapolas", root, *BOTH)
    return root


def codes(summary):
    return [one["code"] for one in summary.get("findings") or ()]


@pytest.mark.parametrize("stage", [["register"], ["fuse"], ["scale", "--method", "pairs"]])
def test_stages_name_the_solution_without_the_lidar(root, stage):
    line = refused(*stage, root, *BOTH)
    assert f"{stage[0]} cannot run" in line
    assert "the maplets contain the lidar (solution both, by spcola fuse --from images)" in line
    assert f"spcola solution use {root} imported" in line
    assert CODE in line


def test_states_of_stages_show_it(root):
    workspace = Workspace.open(root, "both")
    settings = workspace.settings().with_table("scale", method="pairs")
    states = Pipeline(workspace, settings, load_stages()).states()
    barred = {name for name, state in states.items() if "would count twice" in state}
    assert barred == {"register", "fuse", "scale"}


def test_other_solutions_and_other_surfaces_are_free(root):
    call("mapolas", root, "--solution", "images")
    assert CODE not in codes(called("register", root, "--solution", "images")["summary"])
    # The shape was not made of these maplets.
    assert CODE not in codes(called("register", root, *BOTH, "--against", "shape")["summary"])


def test_what_is_accepted_is_among_the_findings(root):
    assert CODE not in codes(called("fuse", root, "--only", NAME)["summary"])
    registered = called("register", root, *BOTH, *ACCEPTED)["summary"]
    assert (registered["verdict"], codes(registered)[-1]) == ("doubtful", CODE)
    twice = called("fuse", root, "--only", NAME, *BOTH, *ACCEPTED)["summary"]
    assert (twice["verdict"], codes(twice)) == ("doubtful", [CODE])
    # Nothing rests on it in silence.
    assert CODE in call("release", root, *BOTH, code=1).stderr


def test_a_further_solution_with_the_lidar_needs_the_same_code(root):
    registration = Workspace.open(root, "both").registration_path
    if not registration.is_file():
        shutil.copy(root / "registration.json", registration)
    given = ("--only", NAME, *BOTH)
    fuse = ("fuse", root, "--from", "images", *given)
    assert CODE in refused(*fuse)
    assert CODE in refused("spc", "lithos", root, *given, "--constraint", "returns")
    content = called(*fuse, *ACCEPTED, "--as", "more")
    (found,) = [one for one in content["findings"] if one["code"] == CODE]
    assert found["names"] == [NAME]
    assert "start from the solution imported" in found["do"]
    # Neither start nor constraints are maplets that contain it.
    anew = ("--start", "shape", "--constraint", "returns", "--as", "anew")
    assert CODE not in codes(called("spc", "lithos", root, *given, *anew))
