"""Poses of COLMAP models: images.bin or images.txt.

COLMAP gives the rotation (quaternion, scalar first) and translation from the world to the camera,
``X_camera = R X + t``, with x to the right, y down and z forward in the image. SPC's axes are the
rows of R: Cx = right, Cy = down, Cz = forward, so that K has positive diagonal terms; V0, from the
pupil to the origin, is ``Rᵀ t``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from spcola.errors import FormatError
from spcola.formats.text.source import KM, as_format_error, read_bytes
from spcola.navigation.states import ImageState, StateSource

_POINT_BYTES = 24
_UNIT = 1e-6


def read_colmap(folder: str | Path, *, unit: Literal["km", "m"]) -> list[tuple[ImageState, int]]:
    """Read the state of each image of a model, by name, and the number of its camera.

    Times and the direction to the Sun are unknown (NaN): COLMAP has none.

    Parameters
    ----------
    folder : str or Path
        With ``images.bin`` or ``images.txt``.
    unit : {"km", "m"}
        Of the model's coordinates; its frame is taken as the body-fixed one.

    Raises
    ------
    FormatError
        If the file is missing or damaged.
    """
    binary = Path(folder) / "images.bin"
    path = binary if binary.is_file() else binary.with_suffix(".txt")
    found = _binary_images(path) if path == binary else _text_images(path)
    metres = KM if unit == "km" else 1.0
    return [(_state(name, pose, metres, path), camera) for name, pose, camera in sorted(found)]


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


@contextmanager
def _line(path: Path, number: int) -> Iterator[None]:
    """Turn errors of a line's words into one line of text."""
    try:
        yield
    except (ValueError, IndexError) as error:
        raise FormatError(f"is no line of COLMAP ({error})", f"{path}, line {number}") from error
