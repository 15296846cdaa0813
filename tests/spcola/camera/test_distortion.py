from __future__ import annotations

import numpy as np
import pytest

from spcola.camera import Camera
from spcola.camera.camera import DistortionModel
from spcola.camera.distortion import distort, distortion_jacobian, undistort
from spcola.errors import InvalidValueError

X, Y = (c.ravel() for c in np.meshgrid(np.linspace(-7, 7, 9), np.linspace(-7, 7, 9)))


def camera(model: DistortionModel, coefficients: list[float], focal_mm: float = 100.0) -> Camera:
    return Camera(focal_mm, [1.0, 1.0], [[100.0, 0, 0], [0, 100.0, 0]], 8, 8, model, coefficients)


def bicubic() -> Camera:
    return camera("bicubic", list(np.random.default_rng(1).normal(size=20) * 1e-5))


CAMERAS = [
    camera("owen", [2e-5, 3e-8, 1e-5, -2e-5]),
    camera("owen", [1e-5, 2e-5, 2e-8, 3e-8, 1e-5, -2e-5]),
    camera("brown", [-0.2, 0.05, 1e-3, -2e-3]),
    camera("brown", [-0.2, 0.05, 1e-3, -2e-3, 0.1]),
    bicubic(),
]


@pytest.mark.parametrize("lens", CAMERAS)
def test_undistort_inverts_distort(lens: Camera) -> None:
    x, y = undistort(lens, *distort(lens, X, Y))
    np.testing.assert_allclose([x, y], [X, Y], atol=1e-11)


@pytest.mark.parametrize("lens", CAMERAS)
def test_jacobian_equals_finite_differences(lens: Camera) -> None:
    step = 1e-4
    along_x = (np.stack(distort(lens, X + step, Y)) - distort(lens, X - step, Y)) / (2 * step)
    along_y = (np.stack(distort(lens, X, Y + step)) - distort(lens, X, Y - step)) / (2 * step)
    expected = np.stack([along_x, along_y], axis=-1).transpose(1, 0, 2)
    np.testing.assert_allclose(distortion_jacobian(lens, X, Y), expected, atol=2e-8)


@pytest.mark.parametrize("model", ["owen", "brown", "bicubic"])
def test_zeros_of_any_number_are_no_distortion(model: DistortionModel) -> None:
    lens = camera(model, [0.0] * 3)
    np.testing.assert_array_equal(distort(lens, X, Y), [X, Y])
    np.testing.assert_array_equal(undistort(lens, X, Y), [X, Y])


def test_owen_radial_term_moves_along_the_radius() -> None:
    dx, dy = np.subtract(distort(camera("owen", [1e-4, 0, 0, 0]), X, Y), [X, Y])
    np.testing.assert_allclose(dx * Y, dy * X, atol=1e-15)
    np.testing.assert_allclose(np.hypot(dx, dy), 1e-4 * np.hypot(X, Y) ** 3, atol=1e-15)


def test_owen_pinwheel_moves_across_the_radius() -> None:
    dx, dy = np.subtract(distort(camera("owen", [1e-4, 0, 1e-6, 0, 0, 0]), X, Y), [X, Y])
    np.testing.assert_allclose(dx * X + dy * Y, 0.0, atol=1e-13)


def test_brown_by_hand() -> None:
    lens = camera("brown", [0.1, 0.0, 0.01, 0.02], focal_mm=10.0)
    x, y = distort(lens, [1.0], [2.0])  # 0.1, 0.2 in focal lengths; r² = 0.05
    np.testing.assert_allclose(x, 10 * (0.1 * 1.005 + 2 * 0.01 * 0.02 + 0.02 * (0.05 + 0.02)))
    np.testing.assert_allclose(y, 10 * (0.2 * 1.005 + 0.01 * (0.05 + 0.08) + 2 * 0.02 * 0.02))


@pytest.mark.parametrize("term", range(20))
def test_bicubic_terms_one_by_one(term: int) -> None:
    coefficients = np.zeros(20)
    coefficients[term] = 1e-4
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3)]
    i, j = powers[term % 10]
    moved = np.subtract(distort(camera("bicubic", list(coefficients)), X, Y), [X, Y])
    expected = np.zeros((2, X.size))
    expected[term // 10] = 1e-4 * X**i * Y**j
    np.testing.assert_allclose(moved, expected, atol=1e-14)


def test_nan_where_the_distortion_cannot_be_inverted() -> None:
    # x + k x³ with k < 0 reaches no further than its turning point
    lens = camera("owen", [-1e-2, 0, 0, 0])
    x, y = undistort(lens, [100.0, 1.0], [0.0, 0.0])
    assert np.isnan(x[0])
    assert np.isnan(y[0])
    assert np.isfinite(x[1])


@pytest.mark.parametrize(
    ("model", "count"), [("owen", 5), ("owen", 3), ("brown", 3), ("brown", 6), ("bicubic", 19)]
)
def test_refuses_another_number_of_coefficients(model: DistortionModel, count: int) -> None:
    with pytest.raises(InvalidValueError, match=f"not {count}"):
        distort(camera(model, [1e-5] * count), X, Y)
