"""``spcola images`` on images whose lines were exposed one after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fusion.workspace import new_workspace
from spcola.camera.instrument import Instrument
from spcola.camera.linescan import LineScan, project_scan, scan_rays
from spcola.formats.cameras import write_cameras
from spcola.navigation import SPICE_LOCK, Spin
from spcola.spice import KernelSet
from spcola.spice.instruments import read_cube_camera
from spcola.spice.kernel_files import (
    ck_of_attitudes,
    clock_items,
    frame_items,
    kernel_text,
    new_ck,
    new_spk,
    rotation_items,
    spk_of_arc,
)

from .box_mission import CAMERA, SIZE, START, content, fits_file, image_at, refusal

MOON, CRAFT, FRAME = 301, -85, -85600
SPIN = Spin(270.0, 67.0, 40.0, 13.176)
NAMES = "image,line,et,scx_m,scy_m,scz_m,cxx,cxy,cxz,cyx,cyy,cyz,czx,czy,czz,sunx,suny,sunz"


def rows_of(path, name, scan, sun, lines, *, with_lines=True):
    """A table of poses at some lines of a scan."""
    found = []
    for line in lines:
        numbers = (scan.times, *scan.positions.T, *scan.axes.reshape(-1, 9).T)
        values = [float(column[line - 1]) for column in numbers] + sun.tolist()
        found.append([name, *([line] if with_lines else []), *map(repr, values)])
    head = NAMES if with_lines else NAMES.replace("line,", "")
    path.write_text("\n".join([head, *(",".join(map(str, row)) for row in found)]) + "\n")
    return path


def apart_px(one, other):
    """How far two scans see the same rays from each other, pixels and lines, both ways."""
    rng = np.random.default_rng(1)
    width, height = one.camera.width, one.height
    pixel, line = rng.uniform(1, width, 200), rng.uniform(2, height - 1, 200)
    worst = 0.0
    for near, far in ((one, other), (other, one)):
        seen = project_scan(far, ground_of(near, pixel, line))
        worst = max(worst, np.abs(seen.pixel - pixel).max(), np.abs(seen.line - line).max())
    return worst


def ground_of(scan, pixel, line):
    origins, beams = scan_rays(scan, pixel, line)
    return origins + 50_000.0 * beams


def kernels_of(folder, scan, sun):
    """SPK, CK, FK, SCLK and PCK of the states of a scan."""
    times, to_body = scan.times, SPIN.axes(scan.times)
    places = np.einsum("nij,ni->nj", to_body, scan.positions) / 1000.0
    velocity = np.gradient(places, times, axis=0)
    away = (sun @ to_body[0]) * 1.5e8
    still = np.concatenate([np.tile(away, (2, 1)), np.zeros((2, 3))], axis=1)
    texts = {
        "moon.tpc": kernel_text("PCK", [], rotation_items(MOON, SPIN, 0.0)),
        "nac.tf": kernel_text("FK", [], {
            **frame_items("TEST_NAC", FRAME, 3, FRAME, CRAFT),
            f"CK_{FRAME}_SCLK": CRAFT, f"CK_{FRAME}_SPK": CRAFT,
        }),
        "clock.tsc": kernel_text("SCLK", [], clock_items(CRAFT, np.floor(times[0]) - 9.0, 10**6)),
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
    with new_spk(folder / "lro.bsp", "TEST", ["A test."]) as handle:
        spk_of_arc(
            handle, "LRO", (CRAFT, MOON), times, np.concatenate([places, velocity], axis=1),
            pad_s=1.0,
        )  # fmt: skip
        spk_of_arc(handle, "SUN", (10, MOON), times[[0, -1]] + [-9.0, 9.0], still)
    with (
        SPICE_LOCK,
        KernelSet([folder / "clock.tsc"]).load(),
        new_ck(folder / "lro.bc", "TEST", ["A test."]) as handle,
    ):
        axes = scan.axes @ to_body
        ck_of_attitudes(handle, "NAC", (FRAME, CRAFT), times, axes, most_s=1e-3)
    return [word for name in (*texts, "lro.bsp", "lro.bc") for word in ("--kernel", folder / name)]


@pytest.mark.real_data
def test_lines_of_a_nac_cube_by_label_table_and_kernels(shared_data, tmp_path):
    cube = shared_data / "isis_cubes" / "M143947267L.cal.echo.crop.cub"
    write_cameras(tmp_path / "nac.toml", [Instrument("NAC", read_cube_camera(cube).camera)])

    def scan_by(folder, *options):
        made = new_workspace(tmp_path / folder, body="Moon")
        (record,) = content("images", made.root, cube, *options)["new"]
        assert record["state"]["lines"] == 400
        return made.line_scan(record["name"])

    camera = ("--camera", tmp_path / "nac.toml")
    label = scan_by("label", "--states", "label")
    for with_lines in (True, False):
        table = rows_of(
            tmp_path / "poses.csv", cube.stem, label.scan, label.sun, [1, *range(4, 401, 4)],
            with_lines=with_lines,
        )  # fmt: skip
        by_table = scan_by(f"table{with_lines}", "--poses", table, *camera)
        assert apart_px(label.scan, by_table.scan) < 1e-3
    kernels = kernels_of(tmp_path, label.scan, label.sun)
    by_spice = scan_by(
        "spice", "--states", "spice", "--frame", "TEST_NAC", "--spacecraft", CRAFT, "--body", MOON,
        "--correction", "none", *kernels, *camera,
    )  # fmt: skip
    assert apart_px(label.scan, by_spice.scan) < 1e-3
    np.testing.assert_allclose(by_spice.sun, label.sun, atol=1e-6)
    made = new_workspace(tmp_path / "ws", body="Moon")
    one = rows_of(tmp_path / "poses.csv", cube.stem, label.scan, label.sun, [200])
    assert "has one state of it" in refusal("images", made.root, cube, "--poses", one, *camera)
    short = rows_of(tmp_path / "poses.csv", cube.stem, label.scan, label.sun, [1, 399])
    assert "lines 1 to 399, the image has 400" in refusal(
        "images", made.root, cube, "--poses", short, *camera
    )
    wide = replace(read_cube_camera(cube).camera, height=400)
    write_cameras(tmp_path / "wide.toml", [Instrument("NAC", wide)])
    assert "its camera has 400 lines" in refusal(
        "images", made.root, cube, "--states", "label", "--camera", tmp_path / "wide.toml"
    )


def test_a_rolling_shutter_has_a_state_for_each_line(given, made, tmp_path):
    planted, line_s = image_at(0), -5e-3
    times = START + line_s * (np.arange(SIZE) - (SIZE - 1) / 2.0)
    since = times[:, None] - START
    spun = Rotation.from_rotvec([1e-4, -2e-4, 3e-4] * since) * Rotation.from_matrix(planted.axes)
    planned = {
        "times": times, "positions": planted.position + since * [20.0, -10.0, 5.0],
        "axes": spun.as_matrix(),
    }  # fmt: skip
    truth = LineScan(CAMERA, **planned, shutter="rolling")
    table = rows_of(tmp_path / "poses.csv", "roll", truth, planted.sun, [1, 50, 90, SIZE],
                    with_lines=False)  # fmt: skip
    path = fits_file(tmp_path / "roll.fit", np.full((SIZE, SIZE), 7, np.uint16))
    write_cameras(tmp_path / "lens.toml", [Instrument("NAC", CAMERA, line_time_s=line_s)])
    camera = ("--camera", tmp_path / "lens.toml")
    assert "has one state of it" in refusal(
        "images", made.root, path, "--poses",
        rows_of(tmp_path / "one.csv", "roll", truth, planted.sun, [64]), *camera,
    )  # fmt: skip
    assert "appears twice" in refusal(
        "images", made.root, path, "--poses", table, "--camera", given / "camera.toml"
    )
    content("images", made.root, path, "--poses", table, *camera)
    scan = made.line_scan("roll").scan
    assert (scan.shutter, scan.height, scan.camera.height) == ("rolling", SIZE, SIZE)
    np.testing.assert_allclose(scan.times, times, atol=1e-6)
    rng = np.random.default_rng(2)
    pixel, line = rng.uniform(1, SIZE, 100), rng.uniform(2, SIZE - 1, 100)
    for one, other in ((scan, truth), (truth, scan)):
        seen = project_scan(other, ground_of(one, pixel, line))
        np.testing.assert_allclose([seen.pixel, seen.line], [pixel, line], atol=1e-3)
    # A frame camera of the middle line is many pixels off.
    frame = LineScan(CAMERA, times, np.tile(truth.positions[64], (SIZE, 1)),
                     np.tile(truth.axes[64], (SIZE, 1, 1)), "rolling")  # fmt: skip
    seen = project_scan(frame, ground_of(truth, pixel, line))
    assert np.nanmax(np.abs(seen.pixel - pixel)) > 0.05
    (shown,) = content("images", made.root, "--report")["images"]
    assert shown["range_m"] == pytest.approx(70_000.0, abs=300.0)
