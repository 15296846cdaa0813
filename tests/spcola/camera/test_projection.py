from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import (
    Camera,
    SpcImage,
    partials_position,
    partials_rotation,
    project_image,
    ray,
    rotate_axes,
)
from spcola.formats.solution import read_landmark, read_summary

MODELS: dict[str, dict[str, Any]] = {
    "none": {},
    "owen": {"distortion": [2e-5, 3e-8, 1e-5, -2e-5]},
    "owen6": {"distortion": [1e-6, 2e-5, 2e-8, 3e-8, 1e-5, -2e-5]},
    "brown": {"distortion_model": "brown", "distortion": [-0.2, 0.05, 1e-3, -2e-3, 0.01]},
    "bicubic": {
        "distortion_model": "bicubic",
        "distortion": [1e-2, 1e-3, -2e-3, 1e-4, 2e-4, -1e-4, 1e-5, 2e-5, -1e-5, 3e-5,
                       -2e-2, 2e-3, 1e-3, -1e-4, 1e-4, 2e-4, 2e-5, -1e-5, 1e-5, 1e-5],
    },
}  # fmt: skip
SKEWED = np.array([[71.4, 0.3, 0.002], [0.1, -71.5, -0.001]])
PLAIN = np.array([[71.4, 0.0, 0.0], [0.0, -71.5, 0.0]])


def camera(model: str = "none", k_matrix: FloatArray = SKEWED) -> Camera:
    return Camera(150.0, [512.5, 500.0], k_matrix, 1024, 1024, **MODELS[model])


def image(model: str = "none", k_matrix: FloatArray = SKEWED) -> SpcImage:
    axes = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    scobj = 5000.0 * axes[2] + [10.0, -20.0, 15.0]
    return SpcImage("P1", "2019 MAR 03 10:00:00", camera(model, k_matrix), scobj, axes, [1.0, 0, 0])


def points(count: int = 40) -> FloatArray:
    return np.random.default_rng(1).uniform(-200, 200, (count, 3))


def test_a_point_on_the_boresight_lies_at_the_optical_axis() -> None:
    shot = image()
    pixel, line = project_image(shot, shot.position + 700.0 * shot.boresight)
    assert (pixel, line) == (pytest.approx(512.5), pytest.approx(500.0))


def test_projection_by_hand() -> None:
    simple = Camera(100.0, [10.0, 20.0], [[50.0, 0, 0], [0, 25.0, 0]], 64, 64)
    shot = replace(image(), camera=simple, axes=np.eye(3), scobj=[0.0, 0, 1000.0])
    pixel, line = project_image(shot, [[1.0, 2.0, 0.0]])
    np.testing.assert_allclose([pixel[0], line[0]], [10 + 50 * 0.1, 20 + 25 * 0.2])


@pytest.mark.parametrize("model", MODELS)
def test_rays_go_back_through_what_was_projected(model: str) -> None:
    shot = image(model)
    places = points()
    away = places - shot.position
    unit = away / np.linalg.norm(away, axis=1, keepdims=True)
    np.testing.assert_allclose(ray(shot, *project_image(shot, places)), unit, atol=1e-13)


@pytest.mark.parametrize("model", MODELS)
def test_every_pixel_is_met_again(model: str) -> None:
    shot = image(model)
    pixel, line = np.meshgrid(np.linspace(1, 1024, 9), np.linspace(1, 1024, 7))
    seen = ray(shot, pixel, line)
    assert seen.shape == (7, 9, 3)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=-1), 1.0, atol=1e-14)
    again = project_image(shot, shot.position + 6000.0 * seen)
    np.testing.assert_allclose(again, [pixel, line], atol=1e-9)


def test_what_lies_behind_projects_nowhere() -> None:
    shot = image()
    behind = shot.position - 100.0 * shot.boresight
    off_side = shot.position + 100.0 * shot.axes[0] - 1e-6 * shot.boresight
    pixel, line = project_image(shot, [behind, off_side, [0.0, 0, 0]])
    np.testing.assert_array_equal(np.isnan(pixel), [True, True, False])
    np.testing.assert_array_equal(np.isnan(line), [True, True, False])
    assert np.isnan(partials_position(shot, behind)).all()


def test_distance_along_the_ray_does_not_matter() -> None:
    shot = image("brown")
    way = ray(shot, 100.0, 900.0)
    near, far = (project_image(shot, shot.position + r * way) for r in (10.0, 1e7))
    np.testing.assert_allclose(near, far, atol=1e-7)


def central_difference(function: Any, step: float) -> FloatArray:
    columns = []
    for axis in np.eye(3):
        ahead, behind = function(step * axis), function(-step * axis)
        columns.append((np.stack(ahead, -1) - np.stack(behind, -1)) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("model", MODELS)
def test_position_partials_equal_finite_differences(model: str) -> None:
    shot = image(model)
    exact = partials_position(shot, points())
    by_point = central_difference(lambda d: project_image(shot, points() + d), 0.1)
    by_state = central_difference(
        lambda d: project_image(replace(shot, scobj=shot.scobj + d), points()), 0.1
    )
    np.testing.assert_allclose(exact, by_point, atol=1e-8)
    np.testing.assert_allclose(exact, by_state, atol=1e-8)


@pytest.mark.parametrize("model", MODELS)
def test_rotation_partials_equal_finite_differences(model: str) -> None:
    shot = image(model)
    exact = partials_rotation(shot, points())
    moved = central_difference(
        lambda turn: project_image(replace(shot, axes=rotate_axes(shot.axes, turn)), points()),
        1e-5,
    )
    np.testing.assert_allclose(exact, moved, rtol=1e-6, atol=1e-4)


def test_partials_are_those_of_the_paper_without_distortion_and_skew() -> None:
    shot = image(k_matrix=PLAIN)
    w = points() + shot.scobj
    x, y, z = (w @ shot.axes.T).T
    f = shot.camera.focal_length_mm
    fx, fy = f * PLAIN[0, 0], f * PLAIN[1, 1]
    cx, cy, cz = shot.axes
    by_w = np.stack(
        [
            fx * (cx * z[:, None] - cz * x[:, None]) / z[:, None] ** 2,
            fy * (cy * z[:, None] - cz * y[:, None]) / z[:, None] ** 2,
        ],
        axis=1,
    )
    by_turn = np.array(
        [
            [fx * x * y / z**2, -fx * (1 + x**2 / z**2), fx * y / z],
            [fy * (1 + y**2 / z**2), -fy * x * y / z**2, -fy * x / z],
        ]
    ).transpose(2, 0, 1)
    np.testing.assert_allclose(partials_position(shot, points()), by_w, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(partials_rotation(shot, points()), by_turn, rtol=1e-12, atol=1e-9)


def test_rotated_axes_stay_orthonormal_and_follow_eq_11() -> None:
    axes = image().axes
    turns = np.array([1e-4, -2e-4, 3e-4])
    moved = rotate_axes(axes, turns)
    np.testing.assert_allclose(moved @ moved.T, np.eye(3), atol=1e-15)
    cx, cy, cz = axes
    t1, t2, t3 = turns
    linear = np.stack([t3 * cy - t2 * cz, t1 * cz - t3 * cx, t2 * cx - t1 * cy])
    np.testing.assert_allclose(moved - axes, linear, atol=2e-7)


@pytest.mark.real_data
def test_67p_landmarks_fall_within_1_5_px_of_the_recorded_place(shared_data: Path) -> None:
    folder = shared_data / "rosetta_67p"
    shot = read_summary(folder / "W48230079013.SUM")
    distances = []
    for seen in shot.landmarks:
        landmark = read_landmark(folder / f"{seen.name}.LMK")
        pixel, line = project_image(shot, landmark.grid.center)
        distances.append(np.hypot(pixel - seen.pixel, line - seen.line))
    assert len(distances) == 3
    assert max(distances) < 1.5
