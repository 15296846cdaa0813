"""``spcola spc register``, through the real command line on frames of a synthetic body."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from command_line import call, called, refused
from scipy.spatial.transform import Rotation

from fusion.stages.spc_register import STATES_KEYS
from fusion.workspace import Workspace, new_workspace
from fusion.workspace.solution_records import read_solution
from spcola.camera import Camera, SpcImage, project_image, rotate_axes
from spcola.formats.images import write_image_data
from spcola.formats.shapes import write_icq
from spcola.formats.solution import read_summary, write_list, write_summary
from spcola.imagematching.frames import render_frame
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions

SIZE, RADIUS = 128, 250.0
LENS = Camera(100.0, [SIZE / 2 + 0.5] * 2, [[60.0, 0, 0], [0, 60.0, 0]], SIZE, SIZE)
FINE_LENS = Camera(
    100.0, [SIZE + 0.5] * 2, [[120.0, 0, 0], [0, 120.0, 0]], 2 * SIZE, 2 * SIZE
)  # fmt: skip


def lumpy(radius: float = RADIUS) -> IcqShape:
    rng = np.random.default_rng(3)
    ways = icq_directions(16)
    reach = np.ones(ways.shape[:-1])
    for wave in (3.0, 5.0, 7.0):
        along = rng.normal(size=3)
        reach += 0.1 * np.cos(ways @ (along * wave / np.linalg.norm(along)))
    return IcqShape(radius * reach[..., None] * ways)


def frame_of(number: int) -> SpcImage:
    """An image of the body at its true state, from another side each."""
    away = np.random.default_rng(number).normal(size=3)
    away *= 36_000.0 / np.linalg.norm(away)
    axes = Rotation.align_vectors([[0, 0, 1.0]], [-away])[0].as_matrix()
    sun = away / np.linalg.norm(away) + 0.9 * axes[0]
    return SpcImage(
        f"F{number}", "2019-03-03T00:00:00", LENS, -away, axes, sun / np.linalg.norm(sun),
        thresholds=(1000, 65535),
    )  # fmt: skip


@pytest.fixture(scope="module")
def misplaced(tmp_path_factory):
    """A workspace with three frames off their states, one of them of another body; the truth."""
    folder = tmp_path_factory.mktemp("spc-register")
    shape = lumpy()
    write_icq(folder / "body.txt", shape, digits=9)
    made = new_workspace(folder / "WS", body="Lumpy", shape=folder / "body.txt")
    caster = RayCaster(shape.mesh())
    true = [frame_of(number) for number in range(3)]
    for number, image in enumerate(true):
        seen = render_frame(caster, image).brightness
        dn = np.rint(40_000.0 * seen).astype(np.uint16)
        if number == 2:
            dn = np.random.default_rng(5).integers(0, 9000, dn.shape).astype(np.uint16)
        write_image_data(made.exposure_path(image.name), dn)
        turned = rotate_axes(image.axes, [3.0 / 6000.0, -2.0 / 6000.0, 0.01])
        off = replace(image, axes=turned, scobj=image.scobj + 60.0)
        write_summary(made.image_path(image.name), off)
    write_list(made.root / "PICTLIST.TXT", [image.name for image in true], kind="image")
    return made, true


@pytest.fixture(scope="module")
def found(misplaced):
    return called("spc", "register", misplaced[0].root, "--position-sigma", 100, "--as", "placed")


def test_states_are_those_of_the_frames(misplaced, found):
    made, true = misplaced
    for image in true[:2]:
        given = read_summary(made.image_path(image.name))
        now = Workspace.open(made.root, "placed").image(image.name)
        middle = 0.8 * RADIUS * image.position / np.linalg.norm(image.position)
        before, after = (
            np.array(project_image(one, middle)) - project_image(image, middle)
            for one in (given, now)
        )
        assert np.abs(before).max() > 1.0
        assert np.abs(after).max() < 0.1
        one = found["images"][image.name]
        np.testing.assert_allclose(one["moved_px"], after - before, atol=0.1)
        assert one["outcome"] == "fitted"
        assert one["correlation"] > 0.97 > one["correlation_start"]
        assert np.isfinite(now.scobj_sigma).all()
        assert np.isfinite(now.pointing_sigma).all()


def test_correlations_before_and_after_the_fit_are_of_the_same_cells(tmp_path):
    """Noise of single pixels: cells of the match are coarser, and correlate better."""
    shape, image = lumpy(), replace(frame_of(0), camera=FINE_LENS)
    write_icq(tmp_path / "body.txt", shape, digits=9)
    made = new_workspace(tmp_path / "WS", body="Lumpy", shape=tmp_path / "body.txt")
    seen = 20_000.0 * render_frame(RayCaster(shape.mesh()), image).brightness
    seen *= 1.0 + 0.4 * np.random.default_rng(1).normal(size=seen.shape)
    write_image_data(made.exposure_path("F0"), np.rint(np.clip(seen, 0, 60_000)).astype(np.uint16))
    write_summary(made.image_path("F0"), image)
    write_list(made.root / "PICTLIST.TXT", ["F0"], kind="image")
    (one,) = called("spc", "register", made.root, "--as", "fitted")["images"].values()
    assert np.abs(one["moved_px"]).max() < 0.2
    assert one["correlation"] < 0.95
    assert one["correlation_start"] == pytest.approx(one["correlation"], abs=2e-3)


def test_an_image_of_something_else_keeps_its_state(misplaced, found):
    made, _ = misplaced
    assert found["images"]["F2"]["outcome"] == "unlike"
    (finding,) = found["findings"]
    assert (finding["code"], finding["names"]) == ("unlike", ["F2"])
    kept = Workspace.open(made.root, "placed").image_path("F2")
    assert kept.read_bytes() == made.image_path("F2").read_bytes()


def test_the_solution_has_its_record_and_its_file(misplaced, found):
    root = misplaced[0].root
    record = read_solution(root, "placed")
    assert (record.parent, record.made_by) == ("imported", "spcola spc register")
    assert record.facts["outcomes"] == {"fitted": 2, "unlike": 1}
    written = json.loads((root / "solutions" / "placed" / "image_states.json").read_text())
    assert set(written) == {key for key in STATES_KEYS if "[" not in key} | {"images"}
    assert set(written["images"]["F0"]) == {
        key.removeprefix("images[].") for key in STATES_KEYS if key.startswith("images[")
    }
    assert written["images"] == found["images"]


@pytest.mark.parametrize("wrong", [lambda dn: dn[:, ::-1], np.rot90, lambda dn: dn[::-1, ::-1]])
def test_mirrored_and_turned_pixels_are_named_and_move_no_state(misplaced, tmp_path, wrong):
    root = tmp_path / "WS"
    shutil.copytree(misplaced[0].root, root, symlinks=True)
    workspace = Workspace.open(root)
    image = workspace.exposed(workspace.image("F0"))
    write_image_data(workspace.exposure_path("F0"), np.ascontiguousarray(wrong(image.pixels)))
    content = called("spc", "register", root, "--only", "F0", "--as", "again")
    assert content["images"]["F0"]["outcome"] == "turned"
    (finding,) = content["findings"]
    assert "--orientation" in finding["do"]
    new, old = (Workspace.open(root, one).image_path("F0") for one in ("again", "imported"))
    assert new.read_bytes() == old.read_bytes()


def test_a_shape_of_another_size_moves_no_state(misplaced, tmp_path):
    root = tmp_path / "WS"
    shutil.copytree(misplaced[0].root, root, symlinks=True)
    path = Workspace.open(root).shape_path()
    path.unlink()
    write_icq(path, lumpy(1.5 * RADIUS), digits=9)
    content = called("spc", "register", root, "--as", "again")
    assert content["outcomes"] == {"unlike": 3}


def test_one_image_and_its_lines(misplaced, found):
    root = misplaced[0].root
    assert found
    lines = call("spc", "register", root, "--only", "F0", "--as", "one").stdout.splitlines()
    assert lines[0] == "solution one, from imported: states of images, 1 fitted"
    assert "correlation with the shape" in lines[1]


def test_what_is_missing_is_named(misplaced, found, tmp_path):
    root = misplaced[0].root
    assert found
    assert "F9" in refused("spc", "register", root, "--only", "F9")
    assert "placed" in refused("spc", "register", root, "--as", "placed")
    bare = new_workspace(tmp_path / "WS", body="Lumpy")
    assert "no image has both pixels and a state" in refused("spc", "register", bare.root)
