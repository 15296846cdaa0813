from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from spcola.camera import Camera
from spcola.camera.projection import project_vectors
from spcola.errors import FormatError
from spcola.formats.cameras import read_colmap_cameras

PARAMETERS = {
    0: [500.0, 320.0, 240.0],
    1: [500.0, 510.0, 320.0, 240.0],
    2: [500.0, 320.0, 240.0, -0.1],
    3: [500.0, 320.0, 240.0, -0.1, 0.02],
    4: [500.0, 510.0, 320.0, 240.0, -0.1, 0.02, 1e-3, -2e-3],
    6: [500.0, 510.0, 320.0, 240.0, -0.1, 0.02, 1e-3, -2e-3, 0.01, 0.1, 0.2, 0.3],
}


def content(*kinds: int) -> bytes:
    parts = [struct.pack("<Q", len(kinds))]
    for number, kind in enumerate(kinds, start=1):
        values = PARAMETERS.get(kind, [])
        parts.append(struct.pack(f"<iiQQ{len(values)}d", number, kind, 640, 480, *values))
    return b"".join(parts)


def read(tmp_path: Path, data: bytes) -> dict[int, Camera]:
    path = tmp_path / "cameras.bin"
    path.write_bytes(data)
    return read_colmap_cameras(path)


def by_hand(kind: int, x: float, y: float) -> list[float]:
    """COLMAP's projection of (x, y, 1), from its documentation."""
    values = PARAMETERS[kind]
    two = kind in (1, 4, 6)
    (fx, fy), rest = (values[:2], values[2:]) if two else ((values[0],) * 2, values[1:])
    k1, k2, p1, p2, k3, k4, k5, k6 = [*rest[2:], *[0.0] * (10 - len(rest))]
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return [fx * u + rest[0], fy * v + rest[1]]


@pytest.mark.parametrize("kind", PARAMETERS)
def test_each_model_projects_as_colmap_does(tmp_path: Path, kind: int) -> None:
    camera = read(tmp_path, content(kind))[1]
    seen = project_vectors(camera, [0.3, -0.2, 1.0])
    # the first pixel's centre is (0.5, 0.5) in COLMAP and (1, 1) here
    np.testing.assert_allclose(seen, np.add(by_hand(kind, 0.3, -0.2), 0.5), rtol=1e-13)


def test_a_file_has_several_cameras(tmp_path: Path) -> None:
    assert list(read(tmp_path, content(0, 4, 1))) == [1, 2, 3]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\1", "too short"),
        (content(1, 4)[:-1], "camera 2 of 2: the file ends in its parameters"),
        (content(1, 4)[:70], "camera 2 of 2: the file ends before it"),
        (content(1) + b"\0", "goes on for 1 bytes"),
        (content(1).replace(struct.pack("<d", 510.0), bytes(8)), "no usable number"),
        (content(5), "has model 5; SIMPLE_PINHOLE"),
        (b"\xff" * 8, "the file ends before it"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        read(tmp_path, data)


@pytest.mark.real_data
def test_the_camera_of_the_vesta_frames(shared_data: Path) -> None:
    (camera,) = read_colmap_cameras(shared_data / "vesta" / "cameras.bin", pixel_mm=0.014).values()
    assert (camera.width, camera.height) == (1024, 1024)
    # Dawn's framing camera: 150 mm, 14 µm
    assert camera.focal_length_mm == pytest.approx(150.0, rel=1e-3)
    np.testing.assert_allclose(camera.center, [511.5, 511.5], atol=2e-3)
    np.testing.assert_allclose(camera.k_matrix[1, 1] / camera.k_matrix[0, 0], 1.000643, atol=1e-6)
