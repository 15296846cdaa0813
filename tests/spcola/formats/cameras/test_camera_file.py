from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spcola.camera import Camera
from spcola.camera.detector import SmearTimes
from spcola.camera.instrument import FocusTable, Instrument, Pupil, ThermalFocus
from spcola.errors import FormatError
from spcola.formats.cameras import read_cameras, write_cameras

OCAMS = [-0.5, -0.2, 2.2e-5, 1.7e-4, 6e-5, 0.0, 0.0]
NEAR = Instrument(
    "POLY CAM",
    Camera(628.9, [513.0, 512.25], [[0, 117.6, 0], [117.6, 0.1, 1e-3]], 1024, 1000, "ocams", OCAMS),
    ThermalFocus(20.0, 1.1e-5),
    FocusTable([1.0, 2.5], [0.005, 0.0], [615.0, 1 / 3], [OCAMS, np.multiply(OCAMS, 1 / 7)]),
    Pupil("POLY CAM", [0.1, -0.2, 1.3]),
    SmearTimes(1 / 3e6, 1e-7, "last line"),
    -1 / 3e3,
)
PLAIN = Instrument("NAC", Camera(100.0, [1.0, 2.0], [[50, 0, 0], [0, 50, 0]], 30, 20))
GOOD = """
[NAC]
focal_length_mm = 100
center = [1, 2]
k_matrix = [[50, 0, 0], [0, -50, 0]]
size = [30, 20]
"""


def test_everything_comes_back_to_the_bit(tmp_path: Path) -> None:
    path = tmp_path / "cameras.toml"
    write_cameras(path, [NEAR, PLAIN], remarks=["from\nstars"])
    assert path.read_text().startswith("# from stars\n")
    back = read_cameras(path)
    assert list(back) == ["POLY CAM", "NAC"]
    one = back["POLY CAM"]
    assert one.temperature == NEAR.temperature
    assert (one.smear, one.line_time_s) == (NEAR.smear, NEAR.line_time_s)
    assert one.pupil is not None
    assert one.focus is not None
    for name in ("center", "k_matrix", "distortion"):
        np.testing.assert_array_equal(getattr(one.camera, name), getattr(NEAR.camera, name))
    for name in ("motor", "inverse_range", "focal_length_mm", "distortion"):
        np.testing.assert_array_equal(getattr(one.focus, name), getattr(NEAR.focus, name))
    np.testing.assert_array_equal(one.pupil.offset, [0.1, -0.2, 1.3])
    again = tmp_path / "again.toml"
    write_cameras(again, back.values(), remarks=["from stars"])
    assert again.read_bytes() == path.read_bytes()
    assert back["NAC"].focus is back["NAC"].pupil is back["NAC"].temperature is None


def test_a_short_table_is_a_pinhole(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text(GOOD)
    camera = read_cameras(path)["NAC"].camera
    assert not camera.distortion.any()
    assert (camera.width, camera.height) == (30, 20)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("focal_length_mm = 100", "", "focal_length_mm: is missing"),
        ("[1, 2]", "[1, 2, 3]", "center: has 3 numbers, not 2"),
        ("[0, -50, 0]", "[0, -50]", "k_matrix: has a row that is not of 3"),
        ("size", "sizes", "sizes: is no field of a camera"),
        ("100", "-100", "focal length must be positive"),
        ("[30, 20]", "[30.5, 20]", "no whole numbers of pixels"),
        ("100", "inf", "focal_length_mm: is no usable number"),
        ("[NAC]", 'distortion_model = "x"', "is no table of a camera"),
        ("size", 'distortion_model = "fisheye"\nsize', "is no distortion"),
        ("[NAC]", "[NAC", "is not TOML"),
        ("size", "frame_transfer = {line = 1}\nsize", "frame_transfer has line; known are"),
        ("size", "frame_transfer = {line_s = -1}\nsize", "frame transfer has times of"),
        ("size", 'frame_transfer = {line_s = 1, memory = "left"}\nsize', "memory side is 'left'"),
        ("size", "line_time_s = 0\nsize", "has lines of 0.0 s"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_cameras(path)


def test_a_name_that_is_no_key_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot name a camera"):
        write_cameras(tmp_path / "c.toml", [Instrument('a"b', PLAIN.camera)])
    assert not list(tmp_path.iterdir())
