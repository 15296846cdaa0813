"""``spcola images``: pixels, states and catalogue; what does not fit is refused in one line."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace

import numpy as np
from astropy.io import fits
from command_line import app
from typer.testing import CliRunner

from fusion.pipeline.solutions import MadeBy, making_solution
from fusion.runtime.folders import LOCK_FILE, locked
from fusion.stages.images import importing
from fusion.stages.images.catalogue import count_images, read_catalogue, write_catalogue
from fusion.workspace import Workspace, new_workspace
from spcola.camera.instrument import Instrument
from spcola.formats.cameras import write_cameras
from spcola.formats.images import read_image_data, write_image_data
from spcola.formats.solution import read_list, write_list, write_summary
from spcola.imagematching.frames import render_frame
from spcola.shape import RayCaster

from .box_mission import (
    CAMERA,
    SIZE,
    START,
    call,
    content,
    files,
    fits_file,
    image_at,
    refusal,
    shape_of,
    states,
    tree,
)


def test_pixels_states_and_catalogue_come_in(given, made):
    write_list(made.root / "PICTLIST.TXT", ["OLD"])
    found = content("images", made.root, *files(given), *states(given))
    assert len(found["new"]) == 6
    assert not found["remarks"]
    records = read_catalogue(made)
    assert count_images(made) == 6
    name = f"F{int(START):09d}"
    record = records[name]
    assert record.original == "frame_of_a_mission_0.fit"
    assert record.source == str(given / "frame_of_a_mission_0.fit")
    assert record.state["source"] == "poses"
    assert record.state["from"] == str(given / "poses.csv")
    assert record.camera == str(given / "camera.toml")
    assert record.label["exposure_s"] == 0.02
    with fits.open(given / "frame_of_a_mission_0.fit") as content_:
        wanted = content_[0].data
    np.testing.assert_array_equal(read_image_data(made.exposure_path(name), SIZE, SIZE), wanted)
    image, planted = made.image(name), image_at(0)
    np.testing.assert_allclose(image.scobj, planted.scobj, atol=1e-4)
    np.testing.assert_allclose(image.axes, planted.axes, atol=1e-9)
    assert image.thresholds == record.pixels.thresholds
    assert 205 < image.thresholds[0] < 800
    assert read_list(made.root / "PICTLIST.TXT") == ["OLD", *sorted(records)]


def test_importing_again_changes_nothing(given, made):
    call("images", made.root, *files(given), *states(given))
    before = tree(made.root)
    again = content("images", made.root, *files(given), *states(given))
    assert not again["new"]
    assert len(again["known"]) == 6
    renamed = made.root.parent / "other_name.fit"
    shutil.copy(files(given, 2)[0], renamed)
    assert not content("images", made.root, renamed)["new"]
    assert tree(made.root) == before


def test_the_workspace_is_the_same_in_any_order_and_after_an_interruption(given, made, tmp_path):
    call("images", made.root, *files(given), *states(given))
    other = new_workspace(tmp_path / "other", body="Box", shape=given / "box.obj")
    call("images", other.root, *files(given, 4, 2), *states(given), "--workers", 1)
    # As killed before the catalogue was written, with one file of pixels missing.
    (other.root / "images.jsonl").unlink()
    sorted(other.root.glob("IMAGEFILES/*"))[0].unlink()
    call("images", other.root, *files(given, 5, 3, 1, 0, 2, 4), *states(given))
    assert tree(other.root) == tree(made.root)


def test_a_killed_import_goes_on(given, made, monkeypatch):
    done = []

    def killed(work, *more):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(work.target.name)
        return original(work, *more)

    original = importing.write_pixels
    monkeypatch.setattr(importing, "write_pixels", killed)
    command = ["images", made.root, *files(given), *states(given), "--workers", 1]
    CliRunner().invoke(app, list(map(str, command)))
    assert len(list(made.root.glob("IMAGEFILES/*.DAT"))) == 3
    assert not list(made.root.glob("SUMFILES/*"))
    counted = []

    def counting(work, *more):
        counted.append(work.target.name)
        return original(work, *more)

    monkeypatch.setattr(importing, "write_pixels", counting)
    assert len(content(*command)["new"]) == 6
    assert len(counted) == 3
    assert not set(counted) & set(done)


def test_a_state_is_added_to_known_pixels(given, made):
    found = content("images", made.root, *files(given))
    assert [one["state"] for one in found["new"]] == [None] * 6
    assert not made.image_names()
    again = content("images", made.root, *files(given), *states(given))
    assert not again["new"]
    assert len(made.image_names()) == 6
    assert all(one.state["source"] == "poses" for one in read_catalogue(made).values())


def test_states_come_in_only_while_nobody_else_works_with_their_solution(given, made):
    with locked(made.root / LOCK_FILE):
        before = tree(made.root)
        assert "is at work here" in refusal("images", made.root, *files(given), *states(given))
        assert tree(made.root) == before
        # Pixels belong to no solution.
        assert len(content("images", made.root, *files(given))["new"]) == 6


def test_equal_bytes_of_another_size_are_another_image(made, tmp_path):
    path = tmp_path / "A.DAT"
    path.write_bytes(bytes(range(96)))
    call("images", made.root, path, "--size", 12, 8)
    assert "as A, read as 12 × 8 pixels and not as 8 × 12" in refusal(
        "images", made.root, path, "--size", 8, 12
    )


def test_solutions_that_rest_on_the_imported_one_do_not_change(given, made):
    call("images", made.root, *files(given, 0, 1), *states(given))
    write_list(made.root / "PICTLIST.TXT", made.image_names())
    with making_solution(made, "next", MadeBy("test", {}, {}, {})):
        pass
    before = tree(made.root / "solutions" / "next")
    first = tree(made.root)
    call("images", made.root, *files(given), *states(given))
    assert tree(made.root / "solutions" / "next") == before
    after = tree(made.root)
    same = set(first) - {"PICTLIST.TXT", "images.jsonl"}
    assert all(after[name] == first[name] for name in same)
    derived = Workspace.open(made.root, "next")
    shutil.copy(files(given, 5)[0], made.root.parent / "x.fit")
    assert len(derived.image_names()) == 2
    assert len(made.image_names()) == 6


def test_states_go_to_the_solution_that_is_named(given, made):
    with making_solution(made, "next", MadeBy("test", {}, {}, {})):
        pass
    call("images", made.root, *files(given), *states(given), "--solution", "next")
    assert len(Workspace.open(made.root, "next").image_names()) == 6
    assert not made.image_names()


def test_what_has_no_partner_is_named(given, made, tmp_path):
    lines = (given / "poses.csv").read_text().splitlines()
    table = tmp_path / "poses.csv"
    table.write_text("\n".join([*lines[:3], lines[6]]) + "\n")
    found = content(
        "images", made.root, *files(given, 0, 1, 2), "--poses", table, "--camera",
        given / "camera.toml",
    )  # fmt: skip
    assert len(found["remarks"]) == 2
    assert "1 state has no image" in found["remarks"][0]
    assert "frame_of_a_mission_2.fit: has no state" in found["remarks"][1]
    assert len(made.image_names()) == 2


def test_bad_input_is_one_line_and_leaves_nothing(given, made, tmp_path):
    before = tree(made.root)
    first = files(given, 0)[0]
    small = fits_file(tmp_path / "small.fit", np.full((8, 8), 5, np.uint16))
    cases = [
        ([*files(given, 0), tmp_path / "none.fit"], "none.fit"),
        ([given / "camera.toml"], "is no FITS"),
        ([first, *states(given)[:2]], "no camera"),
        ([first, "--states", "label", *states(given)[2:]], "no tables of the camera's state"),
        ([first, "--dark", small], "dark frame"),
        ([first, "--flat", tmp_path / "flat.fit"], "flat.fit"),
        ([first, "--poses", given / "camera.toml", "--camera", given / "camera.toml"], "toml"),
    ]
    twin = tmp_path / "another_long_name_of.fit"
    shutil.copy(first, twin)
    cases.append(([first, twin], "holds the same image"))
    together = fits_file(tmp_path / "frame_at_the_same_time.fit", np.full((9, 9), 7, np.uint16))
    cases.append(([first, together], "both get the name"))
    other = replace(CAMERA, width=64)
    write_cameras(tmp_path / "other.toml", [Instrument("NAC", other, None, None, None)])
    cases.append(([first, *states(given)[:2], "--camera", tmp_path / "other.toml"], "pixels"))
    for arguments, words in cases:
        line = refusal("images", made.root, *arguments)
        assert words in line
        assert tree(made.root) == before, line
    for arguments in (["--states", "spice", first], [], ["--bits", "9", first]):
        call("images", made.root, *arguments, code=2)


def test_files_that_are_there_are_not_replaced(given, made):
    name = f"F{int(START):09d}"
    write_image_data(made.exposure_path(name), np.zeros((SIZE, SIZE), np.uint16))
    assert "holds other pixels" in refusal("images", made.root, *files(given, 0))
    made.exposure_path(name).unlink()
    write_summary(made.image_path(name), replace(image_at(3), name=name))
    line = refusal("images", made.root, *files(given, 0), *states(given))
    assert "another state" in line
    # Without a source of states the one that is there is taken, if its size fits.
    (record,) = content("images", made.root, *files(given, 0))["new"]
    assert record["state"]["source"] == "sum"


def test_a_catalogue_of_many_images_is_counted_quickly(made, given):
    call("images", made.root, *files(given, 0))
    (record,) = read_catalogue(made).values()
    write_catalogue(made, (replace(record, name=f"A{n:06d}") for n in range(20_000)))
    begun = time.perf_counter()
    assert count_images(made) == 20_000
    assert time.perf_counter() - begun < 0.2


def test_a_damaged_catalogue_is_one_line(made, given):
    call("images", made.root, *files(given, 0))
    (made.root / "images.jsonl").write_text('{"name": 1}\n')
    assert "images.jsonl, line 1" in refusal("images", made.root, *files(given, 1))


def test_states_and_cameras_of_isd_files(made, tmp_path):
    # A camera 10 km above the equator at longitude 0, looking down; the body is turned by 90°.
    half = float(np.sqrt(0.5))
    isd = {
        "name_model": "USGS_ASTRO_FRAME_SENSOR_MODEL",
        "image_lines": 100, "image_samples": 200, "center_ephemeris_time": START,
        "focal_length_model": {"focal_length": 100.0},
        "detector_center": {"line": 49.5, "sample": 99.5},
        "detector_sample_summing": 1, "detector_line_summing": 1,
        "starting_detector_line": 0, "starting_detector_sample": 0,
        "focal2pixel_samples": [0.0, 50.0, 0.0], "focal2pixel_lines": [0.0, 0.0, 50.0],
        "optical_distortion": {"radial": {"coefficients": [0.0, 0.0, 0.0]}},
        "body_rotation": {
            "reference_frame": 1, "ephemeris_times": [START],
            "quaternions": [[half, 0.0, 0.0, half]],
        },
        "instrument_pointing": {
            "reference_frame": 1, "ephemeris_times": [START],
            "quaternions": [[half, half, 0.0, 0.0]],
        },
        "instrument_position": {"ephemeris_times": [START], "positions": [[0.0, -10.0, 0.0]]},
        "sun_position": {"ephemeris_times": [START], "positions": [[0.0, -1e8, 0.0]]},
    }  # fmt: skip
    (tmp_path / "one.isd").write_text(json.dumps(isd))
    image = fits_file(tmp_path / "one.fit", np.full((100, 200), 7, np.uint16))
    (record,) = content("images", made.root, image, "--states", "isd")["new"]
    assert record["camera"] == str(tmp_path / "one.isd")
    found = made.image("one")
    np.testing.assert_allclose(found.position, [10_000.0, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(found.camera.center, [100.0, 50.0])
    np.testing.assert_allclose(found.sun, [1.0, 0.0, 0.0], atol=1e-9)
    # A line scanner that flies along −y by 10 m each line: its middle line is that of the frame.
    ends = [START - 1.0, START + 1.0]
    isd |= {
        "name_model": "USGS_ASTRO_LINE_SCANNER_SENSOR_MODEL", "image_lines": 5,
        "detector_center": {"line": 0.0, "sample": 99.5},
        "line_scan_rate": [[0.5, -0.025, 0.01]],
        "instrument_position": {
            "ephemeris_times": ends, "positions": [[1.0, -10.0, 0.0], [-1.0, -10.0, 0.0]],
        },
    }  # fmt: skip
    for name in ("body_rotation", "instrument_pointing"):
        isd[name] = {
            **isd[name],
            "ephemeris_times": ends,
            "quaternions": 2 * isd[name]["quaternions"],
        }
    (tmp_path / "lines.isd").write_text(json.dumps(isd))
    lines = fits_file(tmp_path / "lines.fit", np.full((5, 200), 7, np.uint16))
    turned = ["--orientation", "half-turn"]
    assert "its lines were exposed one after the other" in refusal(
        "images", made.root, lines, "--states", "isd", *turned
    )
    (record,) = content("images", made.root, lines, "--states", "isd")["new"]
    assert record["state"]["lines"] == 5
    assert made.image_names() == ["one"]
    scan = made.line_scan("lines").scan
    np.testing.assert_allclose(scan.times - START, np.arange(-2, 3) / 100.0, atol=1e-6)
    np.testing.assert_allclose(scan.positions[:, 0], 10_000.0, atol=1e-3)
    np.testing.assert_allclose(np.diff(scan.positions[:, 1]), -10.0, atol=1e-3)
    (seen,) = [one for one in content("images", made.root, "--report")["images"]
               if one["name"] == "lines"]  # fmt: skip
    # The box ends at 150 m or, at its top, at 30 m.
    assert 9_849.0 < seen["range_m"] < 10_000.0
    other = fits_file(tmp_path / "two.fit", np.full((100, 200), 8, np.uint16), 1)
    (remark,) = content("images", made.root, other, "--states", "isd")["remarks"]
    assert "two.fit: has no state" in remark


def test_images_of_a_camera_with_another_distortion_are_looked_at_with_it(given, tmp_path):
    made = new_workspace(tmp_path / "ws", body="Box", shape=given / "box.obj")
    # Columns bent by 8 px at the upper and lower edge, as the cube of the line.
    bent = np.zeros(20)
    bent[9] = 8.0 / 117.6 / (64.0 / 117.6) ** 3
    lens = replace(CAMERA, distortion_model="bicubic", distortion=bent)
    write_cameras(tmp_path / "lens.toml", [Instrument("NAC", lens)])
    for number in (0, 1):
        image = replace(image_at(number), camera=lens)
        frame = 3000.0 * render_frame(RayCaster(shape_of()), image).brightness + 200.0
        fits_file(tmp_path / f"frame_of_a_mission_{number}.fit", frame.astype(np.uint16), number)
    camera = ["--poses", given / "poses.csv", "--camera", tmp_path / "lens.toml"]
    found = content("images", made.root, *sorted(tmp_path.glob("*.fit")), *camera, "--report")
    (camera_file,) = (made.root / "SUMFILES").glob("CAMERA-*.toml")
    for record, seen in zip(found["new"], found["images"], strict=True):
        assert record["camera_fit"]["file"] == camera_file.name
        assert record["camera_fit"]["largest_px"] > 1.0
        assert seen["fit"]["given"] > 0.999
        assert np.abs(seen["fit"]["offset_px"]).max() < 0.1
    assert read_catalogue(made)[record["name"]].camera_fit == record["camera_fit"]
    camera_file.unlink()
    assert f"{camera_file.name}, which is not there" in refusal("images", made.root, "--report")
