"""Kernels from states of images: read back they give the states, and nothing where none was."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
import spiceypy
from scipy.spatial.transform import Rotation

from spcola.camera import Camera, SpcImage
from spcola.camera.distortion import distort
from spcola.errors import InvalidValueError, KernelError
from spcola.formats.solution import read_summary, write_summary
from spcola.navigation import Spin, et_from_utc, utc_from_et
from spcola.spice import KernelSet, coverage
from spcola.spice.instruments import read_instrument_kernels
from spcola.spice.state_kernels import META_KERNEL, KernelNumbers, write_state_kernels
from spcola.spice.states import Correction, SpiceCamera, spice_states, spin_of

NUMBERS = KernelNumbers(-64, 2101955, "ORX", "BENNU", -64990)
SPIN = Spin(85.45549522840111, -60.36394381230676, 138.8220994, 2011.146011769066, 1.815e-6)
CAMERA = Camera(628.9, [512.5, 512.5], [[117.6, 0, 0], [0, -117.6, 0]], 1024, 1024)
OTHER = replace(CAMERA, focal_length_mm=125.2)
START = et_from_utc("2018-11-08T04:14:47.132")
DAY = 86400.0


def image_at(number, seconds, *, camera=CAMERA):
    """An image of a spacecraft that drifts by 10 cm/s, 5 km from a rotating body."""
    rng = np.random.default_rng(number)
    utc = utc_from_et(START + seconds)
    turn = SPIN.axes([et_from_utc(utc)])[0]
    place = turn @ (np.array([4000.0, -3000.0, 500.0]) + seconds * np.array([0.05, 0.08, -0.02]))
    looking = Rotation.align_vectors([[0, 0, 1.0]], [-place])[0]
    axes = (Rotation.from_rotvec(rng.normal(0.0, 0.01, 3)) * looking).as_matrix()
    return SpcImage(f"P{number:04d}", utc, camera, -place, axes, [1.0, 0.0, 0.0])


TWO_DAYS = [0.0, 120.0, 300.5, 301.1, 900.0, DAY, DAY + 60.0, 3 * DAY]


def mission(seconds=TWO_DAYS):
    return [image_at(number, time) for number, time in enumerate(seconds)]


def read_back(folder, image, frame="ORX_SPC_1"):
    camera = SpiceCamera("ORX", NUMBERS.body, frame, Correction.NONE)
    with KernelSet(folder / META_KERNEL).load():
        return spice_states(camera, [image.name], [et_from_utc(image.utc)])[0]


def assert_same(state, image):
    assert np.linalg.norm(state.scobj - image.scobj) < 1e-3
    assert Rotation.from_matrix(state.axes @ image.axes.T).magnitude() < 1e-6


def test_the_states_of_sum_files_come_back(tmp_path):
    # Through SUM files, whose axes have ten digits.
    images = []
    for image in mission()[::-1]:
        write_summary(tmp_path / "image.SUM", image)
        images.append(read_summary(tmp_path / "image.SUM"))
    made = write_state_kernels(tmp_path / "kernels", images, NUMBERS, SPIN, max_gap_s=700.0)
    assert (made.images, made.cameras, made.segments) == (8, 1, 3)
    assert made.position_m < 1e-6
    assert made.pointing < 1e-8
    for image in images:
        assert_same(read_back(tmp_path / "kernels", image), image)


def test_positions_are_known_within_arcs_and_attitudes_at_images(tmp_path):
    write_state_kernels(tmp_path / "kernels", mission(), NUMBERS, SPIN, max_gap_s=700.0)
    with KernelSet(tmp_path / "kernels" / META_KERNEL).load():
        arcs = coverage("ORX").windows() - START
        shots = coverage("", frame="ORX_SPC_1").windows() - START
        # Between images the drift is a straight line.
        between = spiceypy.spkpos("ORX", START + 600.0, "J2000", "NONE", "BENNU")[0]
    np.testing.assert_allclose(
        arcs, [[-0.5, 900.5], [DAY - 0.5, DAY + 60.5], [3 * DAY - 0.5, 3 * DAY + 0.5]], atol=2e-3
    )
    assert len(shots) == 8
    assert 0.23 < (shots[2, 1] - shots[2, 0]) / 2.0 < 0.25
    expected = np.array([4000.0, -3000.0, 500.0]) + 600.0 * np.array([0.05, 0.08, -0.02])
    np.testing.assert_allclose(1000.0 * between, expected, atol=1e-3)


def test_one_image_alone(tmp_path):
    (image,) = mission([0.0])
    made = write_state_kernels(tmp_path / "kernels", [image], NUMBERS, SPIN, max_gap_s=700.0)
    assert made.segments == 1
    assert_same(read_back(tmp_path / "kernels", image), image)


def test_two_cameras_have_two_frames_and_may_share_a_time(tmp_path):
    images = [*mission([0.0, 60.0]), image_at(7, 0.0, camera=OTHER)]
    made = write_state_kernels(tmp_path / "kernels", images, NUMBERS, SPIN, max_gap_s=700.0)
    assert made.cameras == 2
    with (tmp_path / "kernels" / "images.csv").open() as stream:
        frames = {row["image"]: row["frame"] for row in csv.DictReader(stream)}
    for image in images:
        assert_same(read_back(tmp_path / "kernels", image, frames[image.name]), image)


def test_the_camera_is_in_the_instrument_kernel(tmp_path):
    write_state_kernels(tmp_path / "kernels", mission([0.0]), NUMBERS, SPIN, max_gap_s=700.0)
    with KernelSet(tmp_path / "kernels" / META_KERNEL).load():
        _, frame, boresight, _, corners = spiceypy.getfov(-64990, 4)
        focal = spiceypy.gdpool("INS-64990_FOCAL_LENGTH", 0, 1)[0]
        matrix = spiceypy.gdpool("INS-64990_K_MATRIX", 0, 6)
    assert frame == "ORX_SPC_1"
    assert focal == 628.9
    np.testing.assert_array_equal(matrix.reshape(2, 3), CAMERA.k_matrix)
    np.testing.assert_array_equal(boresight, [0.0, 0.0, 1.0])
    half = 512.0 / 117.6 / 628.9
    np.testing.assert_allclose(
        corners[:, :2] / corners[:, 2:], half * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    )


def test_the_instrument_kernel_gives_the_camera_back(tmp_path):
    """The pixel of the boresight, which such kernels number from 0, and the distortion too."""
    bent = replace(
        CAMERA, center=[500.25, 510.5], k_matrix=[[117.6, 0.01, 2e-4], [0, -117.5, -1e-4]],
        distortion=[1e-6, 0.0, 2e-6, -3e-6],
    )  # fmt: skip
    for number, camera in enumerate((CAMERA, bent)):
        _check_camera(tmp_path / str(number), camera)


def _check_camera(folder, camera):
    image = image_at(0, 0.0, camera=camera)
    write_state_kernels(folder, [image], NUMBERS, SPIN, max_gap_s=700.0)
    found = read_instrument_kernels([next(folder.glob("*.ti"))], -64990).camera
    assert found.focal_length_mm == camera.focal_length_mm
    np.testing.assert_array_equal(found.center, camera.center)
    np.testing.assert_array_equal(found.k_matrix, camera.k_matrix)
    points = np.random.default_rng(1).uniform(-0.003, 0.003, (20, 2))
    for one, two in zip(distort(found, *points.T), distort(camera, *points.T), strict=True):
        np.testing.assert_array_equal(one, two)
    assert (found.width, found.height) == (camera.width, camera.height)


def test_comments_state_where_the_states_come_from(tmp_path):
    write_state_kernels(
        tmp_path / "kernels", mission(), NUMBERS, SPIN, max_gap_s=700.0, about=["Solution: x, y."]
    )
    for name in ("spc_states.bsp", "spc_states.bc"):
        handle = spiceypy.dafopr(str(tmp_path / "kernels" / name))
        _, lines, done = spiceypy.dafec(handle, 100, 200)
        spiceypy.dafcls(handle)
        assert done
        assert "Solution: x, y." in lines
        assert lines[0] == "States of 8 images of an SPC solution, written by SPCOLA."


def test_the_rotation_is_in_the_pck(tmp_path):
    write_state_kernels(
        tmp_path / "kernels", mission(), NUMBERS, SPIN, max_gap_s=700.0, radius_m=246.0
    )
    path = tmp_path / "kernels" / "spc_states.tpc"
    assert spin_of(path, NUMBERS.body) == SPIN
    with pytest.raises(KernelError, match="does not state BODY499_POLE_RA"):
        spin_of(path, 499)
    with KernelSet(path).load():
        np.testing.assert_array_equal(spiceypy.bodvcd(2101955, "RADII", 3)[1], [0.246] * 3)


def test_a_rotation_with_periodic_terms_is_no_spin(tmp_path):
    path = tmp_path / "moon.tpc"
    path.write_text(
        "KPL/PCK\n\\begindata\nBODY401_POLE_RA = ( 317.68 -0.108 0. )\n"
        "BODY401_NUT_PREC_RA = ( 1.79 )\n\\begintext\n"
    )
    with pytest.raises(KernelError, match="states BODY401_NUT_PREC_RA"):
        spin_of(path, 401)


def test_what_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(InvalidValueError, match="no image"):
        write_state_kernels(tmp_path / "kernels", [], NUMBERS, SPIN, max_gap_s=700.0)
    twice = [image_at(1, 0.0), image_at(2, 0.0)]
    with pytest.raises(InvalidValueError, match="P0001: has the time of P0002"):
        write_state_kernels(tmp_path / "kernels", twice, NUMBERS, SPIN, max_gap_s=700.0)
    moved = image_at(2, 0.0, camera=OTHER)
    moved = replace(moved, scobj=moved.scobj + 1.0)
    with pytest.raises(InvalidValueError, match="P0001: has the time of P0002"):
        write_state_kernels(tmp_path / "kernels", [twice[0], moved], NUMBERS, SPIN, max_gap_s=700.0)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    with pytest.raises(KernelError, match="is there already"):
        write_state_kernels(tmp_path / "full", mission(), NUMBERS, SPIN, max_gap_s=700.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full"]
