from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spcola.camera.distortion import distort, undistort
from spcola.camera.projection import project_vectors, view_vectors
from spcola.errors import FormatError
from spcola.spice.instruments import read_instrument_kernels
from spcola.spice.instruments.kernel import inverse_range

PLAIN = """KPL/IK
\\begindata
INS-99_FOV_FRAME = 'X_CAM'
INS-99_FOCAL_LENGTH = ( 1.0D+02 )
INS-99_PIXEL_SIZE = 10
INS-99_PIXEL_SAMPLES = 200
INS-99_PIXEL_LINES = 100
INS-99_CCD_CENTER = ( 99.5, 49.5 )
\\begintext
INS-99_FOCAL_LENGTH = ( 7 )
"""
TRANSFORM = """\\begindata
INS-99_ITRANSS = ( 0, 0, 100.0 )
INS-99_ITRANSL = ( 0, -100.0, 0 )
"""
OPENCV = """INS-99_DISTORTION_MODEL = 'OPENCV'
INS-99_OPENCV_OD_K = ( -0.5, 0.3, -0.1, 0, 0, 0 )
INS-99_OPENCV_OD_P = ( 1E-3, 2E-3 )
INS-99_OPENCV_OD_F = ( 10010, 10020 )
INS-99_OPENCV_OD_C = ( 101, 51 )
INS-99_OPENCV_OD_A = 2.0E-5
"""


def read(tmp_path: Path, *texts: str, **options):
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / f"{number}.ti")
        paths[-1].write_text(text)
    return read_instrument_kernels(paths, -99, **options)


def test_a_kernel_and_its_addendum_by_hand(tmp_path: Path) -> None:
    camera = read(tmp_path, PLAIN, TRANSFORM)
    assert camera.name == "X_CAM"
    assert camera.camera.focal_length_mm == 100.0
    # CCD_CENTER counts from 0
    np.testing.assert_array_equal(camera.camera.center, [100.5, 50.5])
    # x of the frame runs against the lines, y with the samples
    seen = project_vectors(camera.camera, [0.01, 0.02, 1.0])
    np.testing.assert_allclose(seen, [100.5 + 200, 50.5 - 100])


def test_boresight_counts_from_one_unless_told(tmp_path: Path) -> None:
    text = TRANSFORM + "INS-99_BORESIGHT_SAMPLE = 90\nINS-99_BORESIGHT_LINE = 40\n"
    np.testing.assert_array_equal(read(tmp_path, PLAIN, text).camera.center, [90, 40])
    at_zero = read(tmp_path, PLAIN, text, first_pixel=0).camera
    np.testing.assert_array_equal(at_zero.center, [91, 41])


def test_opencv_works_in_samples_and_lines(tmp_path: Path) -> None:
    found = read(tmp_path, PLAIN, TRANSFORM + OPENCV)
    assert found.temperature is not None
    assert (found.temperature.reference_c, found.temperature.per_kelvin) == (0.0, 2e-5)
    # by the definition: u along samples (y of the frame), v along lines (−x)
    u, v = 0.03, -0.05
    r2 = u * u + v * v
    radial = 1 - 0.5 * r2 + 0.3 * r2**2 - 0.1 * r2**3
    p1, p2 = 1e-3, 2e-3
    sample = 101 + 10010 * (u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u))
    line = 51 + 10020 * (v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v)
    np.testing.assert_allclose(project_vectors(found.camera, [-v, u, 1.0]), [sample, line])


def test_a_focal_length_in_metres_is_seen(tmp_path: Path) -> None:
    metres = TRANSFORM + OPENCV + "INS-99_FOCAL_LENGTH = 0.1\n"
    assert read(tmp_path, PLAIN, metres).camera.focal_length_mm == pytest.approx(100.0)
    with pytest.raises(FormatError, match=r"FOCAL_LENGTH: is 50, and OPENCV_OD_F .* 100\.15 mm"):
        read(tmp_path, PLAIN, TRANSFORM + OPENCV + "INS-99_FOCAL_LENGTH = 50\n")


def test_a_filter_comes_first(tmp_path: Path) -> None:
    text = TRANSFORM + (
        "INS-99_DISTORTION_MODEL = 'OCAMS'\nINS-99_OD_K_V = (0, 1E-4, 0, 0, 0)\n"
        "INS-99_OD_CENTER_V = (110.5, 50.5)\nINS-98_FOCAL_LENGTH = 101\n"
    )
    camera = read(tmp_path, PLAIN, text, filter="v", variant=-98).camera
    assert camera.focal_length_mm == 101.0
    # ten samples from the axis: +y by 0.1 mm
    np.testing.assert_allclose(camera.distortion, [0.0, 0.1, 0, 1e-4, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "add the instrument's addendum kernel"),
        (TRANSFORM.replace("100.0, 0 )", "100.0 )"), "ITRANSL: is .* 3 numbers are needed"),
        (TRANSFORM + "INS-99_OD_K = (1, 2, 3, 4)\n", "is no distortion that is read here"),
        (TRANSFORM + "INS-99_OD_K = 1\n", "LROC's NAC"),
        (TRANSFORM + "INS-99_DISTORTION_MODEL = 'CAHVOR'\n", "CAHVOR is no distortion"),
        (TRANSFORM + "INS-99_DISTORTION_MODEL = 'OCAMS'\n", "OD_CENTER: is missing"),
        (TRANSFORM + "INS-99_PIXEL_LINES = 99.5\n", r"is 99\.5, no number of pixels"),
        (TRANSFORM + "INS-99_FOCAL_LENGTH = 'long'\n", "1 numbers are needed"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read(tmp_path, PLAIN, text)


def test_a_kernel_without_instruments_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="state no instrument"):
        read(tmp_path, "KPL/IK\n")


def test_radial_and_rosetta_keywords(tmp_path: Path) -> None:
    camera = read(tmp_path, PLAIN, TRANSFORM + "INS-99_OD_K = (0, 1E-4, 0)\n").camera
    np.testing.assert_allclose(undistort(camera, 1.0, 0.0)[0], 1.0 - 1e-4)
    matrix = "(0, 1.001, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)"
    same = "(0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)"
    text = (
        f"INS-99_TO_UNDISTORTED_X = {matrix}\nINS-99_TO_UNDISTORTED_Y = {same}\n"
        "INS-99_BORESIGHT = (99.5, 49.5, 0)\n"
    )
    camera = read(tmp_path, PLAIN, TRANSFORM + text).camera
    # x = 1 mm is 100 lines from 49.5; times 1.001 they are 149.6495
    np.testing.assert_allclose(undistort(camera, 1.0, 0.5), [1.001495, 0.5], rtol=1e-12)


@pytest.fixture
def ocams(shared_data: Path) -> list[Path]:
    folder = shared_data / "bennu" / "kernels_mapcam_20190303"
    return [folder / "orx_ocams_v07.ti", folder / "orex_ocams_addendum_v10.ti"]


@pytest.mark.real_data
def test_mapcam_has_the_field_of_view_that_its_kernel_states(ocams: list[Path]) -> None:
    mapcam = read_instrument_kernels(ocams, -64361, variant=-64364, filter="PAN")
    camera = mapcam.camera
    assert mapcam.name == "ORX_OCAMS_MAPCAM"
    np.testing.assert_array_equal(camera.center, [513.0, 513.0])
    edges = view_vectors(camera, [0.5, 1024.5, 513.0, 513.0], [513.0, 513.0, 0.5, 1024.5])
    half_deg = np.degrees(np.arccos(edges[:, 2]))
    np.testing.assert_allclose(half_deg, 1.992, atol=0.012)  # half angle of the pan filter
    assert camera.pixel_angle == pytest.approx(67.89e-6, rel=1e-3)  # IFOV of the pan filter
    assert mapcam.temperature is not None
    assert mapcam.temperature.per_kelvin == 1.0941e-05
    # NAXIS1 is +y and NAXIS2 +x of the frame
    pixel, line = project_vectors(camera, [[0.0, 0.01, 1.0], [0.01, 0.0, 1.0]])
    assert pixel[0] - 513 > 100 > abs(line[0] - 513)
    assert line[1] - 513 > 100 > abs(pixel[1] - 513)


@pytest.mark.real_data
def test_polycam_focuses(ocams: list[Path]) -> None:
    polycam = read_instrument_kernels(ocams, -64360, filter="PAN")
    assert polycam.camera.focal_length_mm == 628.9
    assert polycam.focus is not None
    assert len(polycam.focus.motor) == 94
    row = polycam.at(motor=4231)
    # INS-64520 of the addendum
    assert row.camera.focal_length_mm == 615.0104025240411
    assert row.camera.distortion[3] == pytest.approx(1.2808555305529305e-06)
    alone = read_instrument_kernels(ocams, -64360, variant=-64520, filter="PAN")
    np.testing.assert_allclose(alone.camera.distortion, row.camera.distortion)
    # the kernel has PolyCam at 200 m there
    assert 1.0 / inverse_range(4231) == pytest.approx(200.0, rel=0.01)
    assert polycam.at(range_m=np.inf).camera.focal_length_mm == 628.9
    x, y = distort(row.camera, 4.0, 3.0)
    assert 0.1 < np.hypot(x - 4.0, y - 3.0) / 0.0085 < 5.0


@pytest.mark.real_data
def test_the_formula_of_the_kernel_gives_its_own_focal_lengths(ocams: list[Path]) -> None:
    # f = D − E D_focus^F of "Optical Parameter Calculations", and the table of the IK alone
    polycam = read_instrument_kernels(ocams[:1], -64360)
    assert polycam.focus is not None
    rows = polycam.focus.inverse_range > 1e-5
    by_formula = 628.9 - 2684.0 * (1.0 / polycam.focus.inverse_range[rows]) ** -0.9376
    np.testing.assert_allclose(by_formula, polycam.focus.focal_length_mm[rows], atol=0.45)
