from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.camera import Camera, SpcImage, project_image, ray
from spcola.camera.linescan import LineScan, project_scan, scan_rays
from spcola.errors import InvalidValueError

HEIGHT_M = 5000.0
LINES = 400


def camera(height: int = 1) -> Camera:
    """A detector of 600 pixels of 10 µm; lines run along x of the focal plane."""
    return Camera(
        500.0, [300.5, 0.5 * (height + 1)], [[0.5, 100.0, 0.0], [100.0, 0.0, 0.0]], 600, height,
        "lronac", [2e-3],
    )  # fmt: skip


def scan(
    shutter: Literal["line", "rolling"] = "line", *, jitter: float = 2e-5, lines: int = LINES
) -> LineScan:
    """A flight along x at 5 km above the plane z = 0, a line each 0.1 m, with jitter."""
    step = 0.1 if shutter == "line" else 1e-3
    times = np.linspace(0.0, 4.0, lines)
    positions = np.column_stack([step * np.arange(lines), 0.3 * times, HEIGHT_M + 2.0 * times])
    waves = jitter * np.column_stack([np.sin(3 * times), np.cos(5 * times), np.sin(2 * times)])
    down = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    axes = (Rotation.from_rotvec(waves) * down).as_matrix()
    return LineScan(camera(1 if shutter == "line" else lines), times, positions, axes, shutter)


def on_the_ground(origins: FloatArray, directions: FloatArray) -> FloatArray:
    return origins - directions * (origins[..., 2:] / directions[..., 2:])


@pytest.mark.parametrize("shutter", ["line", "rolling"])
def test_both_directions_agree_to_a_millionth_of_a_pixel(
    shutter: Literal["line", "rolling"],
) -> None:
    image = scan(shutter)
    random = np.random.default_rng(3)
    pixel, line = random.uniform(1, 600, 2000), random.uniform(1, LINES, 2000)
    seen = project_scan(image, on_the_ground(*scan_rays(image, pixel, line)))
    np.testing.assert_allclose(seen.pixel, pixel, atol=1e-6)
    np.testing.assert_allclose(seen.line, line, atol=1e-6)
    assert np.all(seen.crossings == 1)


def test_a_steady_flight_has_lines_where_the_ground_has_them() -> None:
    image = scan(jitter=0.0)
    # below the pupil of line 201, which moved 0.1 m a line, and sees 1 cm in y a pixel of 10 µm
    below = np.array([[20.0, 0.0, 0.0], [20.05, 0.0, 0.0]])
    seen = project_scan(
        replace(image, positions=image.positions * [1, 0, 0] + [0, 0, HEIGHT_M]), below
    )
    np.testing.assert_allclose(seen.line, [201.0, 201.5], atol=1e-9)


def test_a_still_rolling_shutter_is_a_frame_camera() -> None:
    image = scan("rolling", jitter=0.0)
    still = replace(image, positions=np.broadcast_to([5.0, 3.0, HEIGHT_M], (LINES, 3)))
    frame = SpcImage("F", "", still.camera, -still.positions[0], still.axes[0], [0, 0, 1.0])
    points = np.column_stack([np.random.default_rng(1).uniform(-9, 9, (50, 2)), np.zeros(50)])
    seen = project_scan(still, points)
    pixel, line = project_image(frame, points)
    inside = (line > 0.5) & (line < LINES + 0.5)
    assert np.count_nonzero(inside) > 10
    np.testing.assert_allclose(seen.pixel[inside], pixel[inside], atol=1e-8)
    np.testing.assert_allclose(seen.line[inside], line[inside], atol=1e-8)
    assert np.all(np.isnan(seen.line[~inside]))
    _, directions = scan_rays(still, pixel[inside], line[inside])
    np.testing.assert_allclose(directions, ray(frame, pixel[inside], line[inside]), atol=1e-14)


def test_points_never_in_view_are_nan() -> None:
    seen = project_scan(scan(), [[-50.0, 0, 0], [1e4, 0, 0], [20.0, 0, 2 * HEIGHT_M], [20.0, 0, 0]])
    assert np.isnan(seen.line[:3]).all()
    assert np.isnan(seen.pixel[:3]).all()
    assert list(seen.crossings) == [0, 0, 0, 1]


def test_a_camera_that_sweeps_back_sees_the_ground_twice() -> None:
    image = scan(jitter=0.0)
    forth = 20.0 - np.abs(np.linspace(-20.0, 20.0, LINES))
    back = replace(image, positions=np.column_stack([forth, 0 * forth, 0 * forth + HEIGHT_M]))
    seen = project_scan(back, [[10.0, 0.0, 0.0]])
    assert seen.crossings[0] == 2
    assert seen.line[0] < LINES / 2


def test_a_rolling_shutter_shears_the_image() -> None:
    # In the focal plane y is along pixels: a pupil that moves by 1 mm a line towards +y, 5 km up,
    # sees a point move by 1 mm / 5 km · 500 mm = 1e-4 mm, a hundredth of a pixel, a line.
    image = scan("rolling", jitter=0.0)
    still = np.broadcast_to([0.0, 0.0, HEIGHT_M], (LINES, 3))
    lens = replace(image.camera, k_matrix=[[0.0, 100, 0], [100, 0.0, 0]], distortion=np.zeros(1))
    moving = replace(image, camera=lens, positions=still + [[0, 1e-3 * n, 0] for n in range(LINES)])
    column = np.column_stack([np.linspace(-15.0, 15.0, 7), np.zeros((7, 2))])
    before = project_scan(replace(moving, positions=still), column)
    after = project_scan(moving, column)
    np.testing.assert_allclose(after.line, before.line, atol=1e-9)
    np.testing.assert_allclose(after.pixel - before.pixel, 0.01 * (after.line - 1), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": np.zeros(LINES)}, "do not run one way"),
        ({"positions": np.zeros((3, 3))}, "shape"),
        ({"axes": np.broadcast_to(np.diag([1.0, 1.0, -1.0]), (LINES, 3, 3))}, "right-handed"),
        ({"shutter": "rolling"}, "a detector of 1"),
    ],
)
def test_refuses_states_that_are_none(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        replace(scan(), **change)  # type: ignore[arg-type]
