"""Images that are mirrored, turned or transposed are named by ``spc lithos``; right ones never."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import called
from photographs import Painted
from solved_workspace import SIGHTS

from fusion.stages.images import Turn
from fusion.workspace import Workspace, new_workspace
from spcola.formats.images import write_image_data
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_summary
from spcola.grids import Maplet, MapletGrid

PLACE, NORMAL, MAPLET = np.array([80.0, 20.0, 10.0]), np.array([0.9, 0.3, 0.2]), "AA0001"
NAMES = [f"I{k}" for k in range(len(SIGHTS))]
SOME = ("TR0006", "TR0011", "TR0016", "TR0020", "TR0021")


def turn_files(root, turn, wanted=lambda image: True):
    """Turn the pixels of images in their files; return their names."""
    workspace, names = Workspace.open(root), []
    for name in workspace.image_names():
        path = workspace.exposure_path(name)
        if not path.is_file() or not wanted(workspace.image(name)):
            continue
        pixels = workspace.exposed(workspace.image(name)).pixels
        path.unlink()
        write_image_data(path, np.ascontiguousarray(turn.orientation.apply(pixels)))
        names.append(name)
    return names


def orientations(content):
    return [one for one in content["findings"] if one["code"] == "image-orientation"]


@pytest.fixture(scope="module")
def photographs():
    ground = Painted(MapletGrid.facing(PLACE, NORMAL, 0.5, 16))
    return ground, [ground.photograph(f"I{k}", *sight, size=64) for k, sight in enumerate(SIGHTS)]


@pytest.fixture
def root(photographs, tmp_path):
    """A workspace of one flat maplet and its photographs."""
    ground, images = photographs
    made = new_workspace(tmp_path / "WS", body="Waves")
    write_maplet(made.maplet_path(MAPLET), Maplet(MAPLET, ground.grid, np.zeros(ground.grid.shape)))
    for image in images:
        write_image_data(made.exposure_path(image.name), image.pixels)
        write_summary(made.image_path(image.name), image)
    return made.root


def solve(root):
    return called("spc", "lithos", root, "--constraint", "none", "--photometry", "lambert")


@pytest.mark.parametrize(
    ("done", "mends"),
    [
        (Turn.MIRRORED_SAMPLES, {"mirrored-samples", "mirrored-lines"}),
        (Turn.MIRRORED_LINES, {"mirrored-samples", "mirrored-lines"}),
        (Turn.TRANSPOSED, {"transposed", "anti-transposed"}),
        (Turn.QUARTER_TURN_LEFT, {"quarter-turn-right", "quarter-turn-left"}),
    ],
)
def test_one_maplet_names_the_orientation_that_fits(root, done, mends):
    assert turn_files(root, done) == NAMES
    found = orientations(solve(root))
    assert [one["names"] for one in found] == [NAMES]
    # From above, a half turn more shows hills as hollows and fits as well.
    words = found[0]["do"].split("fits better ")[1].split(":")[0]
    assert set(words.split(" or ")) == mends
    assert "spcola images --orientation" in found[0]["do"]


def test_right_images_and_those_with_a_wrong_sun_or_other_ground_are_not_named(root, photographs):
    assert not orientations(solve(root))
    workspace, up = Workspace.open(root), photographs[0].grid.uz
    for image in photographs[1]:
        workspace.image_path(image.name).unlink()
        turned = 2.0 * (image.sun @ up) * up - image.sun
        write_summary(workspace.image_path(image.name), replace(image, sun=turned))
    for one in orientations(solve(root)):
        assert "or with all Suns on the other side" in one["do"]
    rng = np.random.default_rng(1)
    for image in photographs[1]:
        workspace.exposure_path(image.name).unlink()
        rolled = np.roll(image.pixels, rng.integers(12, 52, 2), axis=(0, 1))
        write_image_data(workspace.exposure_path(image.name), rolled)
    assert not orientations(solve(root))


@pytest.fixture
def mission(imaged_mission, tmp_path):
    copy = tmp_path / "WS"
    shutil.copytree(imaged_mission[0], copy)
    shutil.rmtree(copy / "solutions", ignore_errors=True)
    return copy


def solve_some(root):
    only = [part for name in SOME for part in ("--only", name)]
    return called("spc", "lithos", root, *only, "--start", "shape")


def test_all_images_of_a_mission_are_named_and_right_ones_are_not(mission):
    assert not orientations(solve_some(mission))
    turned = turn_files(mission, Turn.MIRRORED_SAMPLES)
    found = orientations(solve_some(mission))
    assert len(found) == 1
    assert len(found[0]["names"]) >= 8
    assert set(found[0]["names"]) <= set(turned)
    assert "fits better mirrored-samples: " in found[0]["do"]


def test_one_of_two_cameras_is_named(mission):
    workspace = Workspace.open(mission)
    images = [workspace.image(name) for name in workspace.image_names()]
    longest = max(image.camera.focal_length_mm for image in images)
    turned = turn_files(
        mission, Turn.TRANSPOSED, lambda image: image.camera.focal_length_mm == longest
    )
    assert 0 < len(turned) < len(images)
    found = orientations(solve_some(mission))
    assert len(found) == 1
    assert set(found[0]["names"]) <= set(turned)
    assert "fits better transposed: " in found[0]["do"]
