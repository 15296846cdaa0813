"""The one camera of a file: a .SUM file or a camera file."""

from __future__ import annotations

from pathlib import Path

from spcola.camera import Camera
from spcola.camera.instrument import Instrument
from spcola.errors import InvalidValueError
from spcola.formats.cameras import read_cameras
from spcola.formats.solution.sum import read_summary

__all__ = ["read_camera", "read_one_instrument"]


def read_camera(path: Path) -> tuple[Camera, tuple[int, int] | None]:
    """Return the camera in a .SUM file or a camera file, and the thresholds of the former.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError, InvalidValueError
        See :func:`read_one_instrument`.
    """
    instrument, thresholds = read_one_instrument(path)
    return instrument.camera, thresholds


def read_one_instrument(path: Path) -> tuple[Instrument, tuple[int, int] | None]:
    """Return the camera in a .SUM file or a camera file as an instrument, and thresholds.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FormatError
        If the file cannot be read.
    InvalidValueError
        If it has several cameras.
    """
    if path.suffix.lower() != ".toml":
        image = read_summary(path)
        return Instrument(path.stem, image.camera), image.thresholds
    cameras = read_cameras(path)
    if len(cameras) > 1:
        raise InvalidValueError(f"has the cameras {', '.join(cameras)}", path, "keep one of them")
    (instrument,) = cameras.values()
    return instrument, None
