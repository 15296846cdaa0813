"""The file of a line-scan image's states."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.camera import Camera
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.control import scaled
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.solution.line_scan import is_line_scan, read_line_scan, write_line_scan


@pytest.fixture
def image() -> LineScanImage:
    turns = Rotation.from_rotvec(np.outer(np.arange(5), [1e-4, 2e-4, 0.3e-4]))
    camera = Camera(699.62, [-451.0, 1.0], [[0, 142.9, 0], [142.9, 0, 0]], 400, 1, "lronac", [1e-5])
    positions = np.array([[1.8e6, 10.0 * i, 3.0] for i in range(5)]) / 3.0
    scan = LineScan(camera, 1e8 + np.arange(5) / 3000.0, positions, turns.as_matrix())
    return LineScanImage("M1", scan, np.array([0.6, 0.0, 0.8]), (842, 65535))


def test_all_digits_come_back(tmp_path, image):
    path = tmp_path / "M1.h5"
    write_line_scan(path, image)
    back = read_line_scan(path)
    assert is_line_scan(path)
    assert (back.name, back.size, back.thresholds) == ("M1", (400, 5), (842, 65535))
    for name in ("times", "positions", "axes"):
        np.testing.assert_array_equal(getattr(back.scan, name), getattr(image.scan, name))
    np.testing.assert_array_equal(back.scan.camera.distortion, [1e-5])
    first = path.read_bytes()
    write_line_scan(path, back)
    assert path.read_bytes() == first


def test_a_changed_number_is_noticed(tmp_path, image):
    path = tmp_path / "M1.h5"
    write_line_scan(path, image)
    with h5py.File(path, "r+") as file:
        file["positions"][2, 1] += 1e-9
    with pytest.raises(FormatError, match="its content has another digest"):
        read_line_scan(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(FormatError, match="is damaged"):
        read_line_scan(path)


def test_lengths_are_scaled_and_nothing_else(image):
    larger = scaled(image, 1.5)
    np.testing.assert_array_equal(larger.scan.positions, 1.5 * image.scan.positions)
    np.testing.assert_array_equal(larger.scan.axes, image.scan.axes)
    np.testing.assert_array_equal(larger.sun, image.sun)


def test_the_sun_is_a_direction(image):
    with pytest.raises(InvalidValueError, match="is not a unit vector"):
        LineScanImage("M1", image.scan, np.array([1.0, 1.0, 0.0]))
