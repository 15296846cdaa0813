"""The mission forms of distortion, with the coefficients that are published for each."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.camera.camera import DistortionModel
from spcola.camera.distortion import (
    COEFFICIENTS,
    distort,
    distortion_jacobian,
    undistort,
    unfolded_radius,
)
from spcola.errors import InvalidValueError

# INS-915240 of the ISIS labels: Apollo 15's metric camera, 114 mm of film in 5 µm pixels.
APOLLO = [-0.006, -0.002, -1.3361854e-06, 5.2261757e-10, -5.0728336e-14, -5.4958195e-07,
          -4.608942e-11, 2.965907]  # fmt: skip
# INS-64500_OD_K_PAN and centre: PolyCam, and MapCam's pan filter, by the addendum kernel.
POLYCAM = [-0.08, -0.14, 0, 1.2399363343630704e-06, 3.578907146911589e-05, 0, 0]
MAPCAM = [-0.52, -0.22, 2.21e-05, 1.71e-04, 5.96e-05, 0.0, 0.0]
# hyb2_onc_c_dist_20190131.db: a1, a3, a5 and b1 … b5 of ONC-W1.
ONC_W1 = [0.013, 1.0, 3.134e-7, -1.716e-13]
ONC_W1_BACK = [0.0, 9.99570e-1, 1.19590e-5, -4.15730e-7, 3.71770e-10, -9.07150e-14]


def rosetta() -> list[float]:
    """A distortion of OSIRIS's size: some pixels in the corners of 2048 × 2048."""
    random = np.random.default_rng(4)
    scale = np.array([[1.0 / 2048.0 ** (i + j) for i in range(4)] for j in range(4)])
    small = np.triu(np.ones((4, 4)))[:, ::-1] * scale * random.normal(scale=2.0, size=(2, 4, 4))
    small[0, 0, 1] += 1.0
    small[1, 1, 0] += 1.0
    return [0.0135, 1023.5, 1023.5, *small.ravel()]


def transverse() -> list[float]:
    moved = np.random.default_rng(5).normal(scale=1e-5, size=20)
    moved[[1, 12]] += 1.0
    return list(moved)


def camera(
    model: DistortionModel, coefficients: list[float], focal_mm: float, pitch: float, size: int
) -> Camera:
    center = [0.5 + size / 2, 0.5 + size / 2]
    plain = [[1 / pitch, 0.0, 0.0], [0.0, 1 / pitch, 0.0]]
    return Camera(focal_mm, center, plain, size, size, model, coefficients)


CAMERAS = [
    camera("hasselblad", APOLLO, 76.054, 0.02, 5700),
    camera("radial", [1e-3, -1e-5, 1e-8], 105.0, 0.012, 1024),
    camera("transverse", transverse(), 550.0, 0.014, 1024),
    camera("rosetta", rosetta(), 717.0, 0.0135, 2048),
    camera("hayabusa2", [0.013, 1.0, -9.28e-9, 0.0], 121.1, 0.013, 1024),
    camera("hayabusa2", ONC_W1, 10.22, 0.013, 1024),
    camera("ocams", MAPCAM, 125.2, 0.0085, 1024),
    camera("ocams", POLYCAM, 610.7, 0.0085, 1024),
    camera("lronac", [1.81e-5], 699.62, 0.007, 5064),
    camera("brown", [0.91, -14.5, 4.3e-3, 1.1e-3, -0.017, 0.1, -0.2, 0.3], 125.2, 0.0085, 1024),
]
NAMES = [f"{lens.distortion_model}{number}" for number, lens in enumerate(CAMERAS)]


def field(lens: Camera, count: int = 41) -> tuple[FloatArray, FloatArray]:
    """Return true focal-plane positions over the whole detector, mm."""
    half = lens.width / 2 / lens.k_matrix[0, 0]
    x, y = np.meshgrid(np.linspace(-half, half, count), np.linspace(-half, half, count))
    return x.ravel(), y.ravel()


@pytest.mark.parametrize("lens", CAMERAS, ids=NAMES)
def test_both_directions_agree_to_a_millionth_of_a_pixel(lens: Camera) -> None:
    x, y = field(lens)
    back = distort(lens, *undistort(lens, x, y))
    assert np.all(np.hypot(back[0] - x, back[1] - y) * lens.k_matrix[0, 0] < 1e-6)


@pytest.mark.parametrize("lens", CAMERAS, ids=NAMES)
def test_partials_equal_finite_differences(lens: Camera) -> None:
    x, y = undistort(lens, *field(lens, 9))
    step = 1e-4
    along_x = (np.stack(distort(lens, x + step, y)) - distort(lens, x - step, y)) / (2 * step)
    along_y = (np.stack(distort(lens, x, y + step)) - distort(lens, x, y - step)) / (2 * step)
    expected = np.stack([along_x, along_y], axis=-1).transpose(1, 0, 2)
    np.testing.assert_allclose(distortion_jacobian(lens, x, y), expected, atol=1e-7)


@pytest.mark.parametrize("lens", CAMERAS, ids=NAMES)
def test_each_form_moves_points_by_a_measurable_amount(lens: Camera) -> None:
    x, y = field(lens)
    ideal = undistort(lens, x, y)
    assert np.max(np.hypot(ideal[0] - x, ideal[1] - y)) * lens.k_matrix[0, 0] > 0.3


def test_hayabusa2_agrees_with_the_archive_inverse() -> None:
    # The archive's own inverse polynomial is good to a third of a pixel up to the corners.
    lens = camera("hayabusa2", ONC_W1, 10.22, 0.013, 1024)
    corrected = np.linspace(0, 700, 100)
    observed, _ = distort(lens, corrected * 0.013, 0 * corrected)
    archive = np.polynomial.Polynomial(ONC_W1_BACK)(corrected)
    np.testing.assert_allclose(observed / 0.013, archive, atol=0.3)


def test_hasselblad_by_hand() -> None:
    lens = camera("hasselblad", [0.5, -0.5, 1e-3, 0, 0, 1e-2, 0, np.pi / 2], 76.0, 0.02, 5700)
    x, y = undistort(lens, [3.5], [3.5])  # (3, 4) from the principal point, r² = 25
    np.testing.assert_allclose([x[0], y[0]], [3 * 1.025 - 0.25, 4 * 1.025], rtol=1e-14)


def test_radial_and_lronac_by_hand() -> None:
    x, y = undistort(camera("radial", [0.01, 1e-3, 0], 100.0, 0.01, 1000), [3.0], [4.0])
    np.testing.assert_allclose([x[0], y[0]], [3 * (0.99 - 0.025), 4 * (0.99 - 0.025)])
    x, y = undistort(camera("lronac", [0.01], 700.0, 0.007, 1000), [3.0], [2.0])
    np.testing.assert_allclose([x[0], y[0]], [3.0, 2.0 / 1.04])


def test_ocams_by_hand() -> None:
    lens = camera("ocams", [1.0, 2.0, 0.0, 1e-3, 0, 0, 0], 125.0, 0.0085, 1024)
    x, y = distort(lens, [4.0], [6.0])  # r = 5
    np.testing.assert_allclose([x[0], y[0]], [4 + 3 * 5e-3, 6 + 4 * 5e-3])
    np.testing.assert_array_equal(distortion_jacobian(lens, [1.0], [2.0])[0], np.eye(2))


def test_transverse_and_bicubic_are_one_polynomial() -> None:
    offset = np.random.default_rng(2).normal(scale=1e-4, size=20)
    whole = offset.copy()
    whole[[1, 12]] += 1.0
    x, y = field(CAMERAS[2])
    one = distort(camera("bicubic", list(offset), 550.0, 0.014, 1024), x, y)
    other = distort(camera("transverse", list(whole), 550.0, 0.014, 1024), x, y)
    np.testing.assert_allclose(one, other, atol=1e-13)


@pytest.mark.parametrize(
    "lens",
    [
        camera("brown", [-0.4, 0.0, 0.0, 0.0], 5.0, 0.01, 1000),
        # upright again behind its fold: 1 + 3 k1 r² + 5 k2 r⁴ has two roots
        camera("brown", [-1.2, 0.4, 0.0, 0.0], 5.0, 0.01, 1000),
    ],
)
def test_nothing_behind_a_fold_comes_into_the_image(lens: Camera) -> None:
    limit = unfolded_radius(lens)
    assert np.isfinite(limit)
    tangent = np.linspace(0.0, 40.0, 4001)
    x, _ = distort(lens, tangent, 0 * tangent)
    assert np.all(np.isfinite(x[tangent < 0.9 * limit]))
    assert np.all(np.isnan(x[tangent > limit]))
    seen = x[np.isfinite(x)]
    assert np.all(np.diff(seen) > 0)
    back, _ = undistort(lens, seen, 0 * seen)
    np.testing.assert_allclose(back[np.isfinite(back)], tangent[: len(seen)][np.isfinite(back)])


def test_every_name_has_a_model() -> None:
    assert set(get_args(DistortionModel)) == set(COEFFICIENTS)


def test_refuses_an_unknown_model() -> None:
    with pytest.raises(InvalidValueError, match="is no distortion"):
        Camera(1.0, [0, 0], np.eye(2, 3), 1, 1, "fisheye")  # type: ignore[arg-type]
