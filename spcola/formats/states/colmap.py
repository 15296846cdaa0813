"""Poses of COLMAP models: images.bin or images.txt, and cameras.bin or cameras.txt.

COLMAP gives the rotation (quaternion, scalar first) and translation from the world to the camera,
``X_camera = R X + t``, with x to the right, y down and z forward in the image. SPC's axes are the
rows of R: Cx = right, Cy = down, Cz = forward, so that K has positive diagonal terms; V0, from the
pupil to the origin, is ``Rᵀ t``. The first pixel has its centre at (0.5, 0.5) in COLMAP and at
(1, 1) in SPC: 0.5 is added to principal points.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.errors import FormatError
from spcola.formats.text.source import KM, as_format_error, read_bytes
from spcola.navigation.states import ImageState, StateSource

_MODELS = (
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
)
_POINT_BYTES = 24
_UNIT = 1e-6


@dataclass(frozen=True)
class ColmapCamera:
    """A camera of a COLMAP model, as in its file.

    Parameters
    ----------
    model : str
        COLMAP's name of the camera model, such as ``PINHOLE``.
    width, height : int
    parameters : tuple of float
        Focal lengths and principal point, pixels, and coefficients of distortion in the order of
        the model; the centre of the first pixel is (0.5, 0.5).
    """

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


def read_colmap(
    folder: str | Path, *, unit: Literal["km", "m"]
) -> list[tuple[ImageState, ColmapCamera]]:
    """Read a model: the state of each image, by name, and its camera.

    Times and the direction to the Sun are unknown (NaN): COLMAP has none.

    Parameters
    ----------
    folder : str or Path
        With ``images`` and ``cameras``, both ``.bin`` or ``.txt``.
    unit : {"km", "m"}
        Of the model's coordinates; its frame is taken as the body-fixed one.

    Raises
    ------
    FormatError
        If a file is missing or damaged, or an image has no camera.
    """
    root = Path(folder)
    binary = (root / "images.bin").is_file()
    suffix = ".bin" if binary else ".txt"
    images, cameras = root / f"images{suffix}", root / f"cameras{suffix}"
    known = dict(_binary_cameras(cameras) if binary else _text_cameras(cameras))
    found = _binary_images(images) if binary else _text_images(images)
    pairs = []
    for name, pose, camera in sorted(found):
        if camera not in known:
            raise FormatError(f"{name} has the camera {camera}, which is not there", cameras)
        pairs.append((_state(name, pose, KM if unit == "km" else 1.0, images), known[camera]))
    return pairs


def _state(name: str, pose: tuple[float, ...], metres: float, path: Path) -> ImageState:
    """Return the state by a quaternion and a translation (7 numbers)."""
    quaternion, translation = np.array(pose[:4]), np.array(pose[4:])
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) < _UNIT:
        raise FormatError(f"the quaternion of {name} has the length {length:.6g}, not 1", path)
    axes = Rotation.from_quat(quaternion[[1, 2, 3, 0]]).as_matrix()
    with as_format_error(f"{path}, {name}"):
        return ImageState(name, np.nan, metres * axes.T @ translation, axes, StateSource.COLMAP)


class _Bytes:
    """The content of a binary file, read in order."""

    def __init__(self, path: Path) -> None:
        self.path, self.content, self.place = path, read_bytes(path), 0

    def take(self, form: str) -> tuple[float, ...]:
        """Return the next numbers, little-endian."""
        size = struct.calcsize(f"<{form}")
        self.skip(size)
        return struct.unpack_from(f"<{form}", self.content, self.place - size)

    def skip(self, size: int) -> None:
        """Pass over some bytes."""
        if not 0 <= size <= len(self.content) - self.place:
            raise FormatError(
                f"ends at byte {len(self.content)}, {size} more are stated at {self.place}",
                self.path,
                "copy it again",
            )
        self.place += size

    def name(self) -> str:
        """Return the text up to the next zero byte."""
        end = self.content.find(b"\0", self.place)
        if end < 0:
            raise FormatError("ends within a name", self.path, "copy it again")
        text = self.content[self.place : end]
        self.place = end + 1
        return text.decode("utf-8", "backslashreplace")


def _binary_images(path: Path) -> Iterator[tuple[str, tuple[float, ...], int]]:
    """Yield name, pose and camera of each image of a binary file."""
    content = _Bytes(path)
    for _ in range(int(content.take("Q")[0])):
        _, *pose, camera = content.take("I7dI")
        name = content.name()
        content.skip(_POINT_BYTES * int(content.take("Q")[0]))
        yield name, tuple(pose), int(camera)


def _binary_cameras(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    """Yield number and camera of each camera of a binary file."""
    content = _Bytes(path)
    for _ in range(int(content.take("Q")[0])):
        number, code, width, height = (int(value) for value in content.take("IiQQ"))
        if not 0 <= code < len(_MODELS):
            raise FormatError(f"camera {number} has the unknown model {code}", path)
        model, count = _MODELS[code]
        yield number, ColmapCamera(model, width, height, tuple(content.take(f"{count}d")))


def _text_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield number and words of each line that is no comment."""
    text = read_bytes(path).decode("utf-8", "backslashreplace")
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.startswith("#"):
            yield number, line.split()


def _text_images(path: Path) -> Iterator[tuple[str, tuple[float, ...], int]]:
    """Yield name, pose and camera of each image of a text file: every second line has points."""
    for number, words in list(_text_lines(path))[::2]:
        if not words:
            continue
        with _line(path, number):
            pose = tuple(float(word) for word in words[1:8])
            yield " ".join(words[9:]), pose, int(words[8])


def _text_cameras(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    """Yield number and camera of each camera of a text file."""
    counts: Mapping[str, int] = dict(_MODELS)
    for number, words in _text_lines(path):
        if not words:
            continue
        with _line(path, number):
            parameters = tuple(float(word) for word in words[4:])
            if counts.get(words[1]) != len(parameters):
                raise ValueError(f"{words[1]} with {len(parameters)} parameters")
            yield int(words[0]), ColmapCamera(words[1], int(words[2]), int(words[3]), parameters)


@contextmanager
def _line(path: Path, number: int) -> Iterator[None]:
    """Turn errors of a line's words into one line of text."""
    try:
        yield
    except (ValueError, IndexError) as error:
        raise FormatError(f"is no line of COLMAP ({error})", f"{path}, line {number}") from error
