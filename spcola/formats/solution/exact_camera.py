"""Cameras that a .SUM file cannot hold: the nearest that it can, and a file with the exact one.

A .SUM file has four coefficients of Owen's distortion. Where these do not reproduce a camera to
`FIT_LIMIT_PX`, it has those that fit best, and names after its END FILE, where SPC's programs do
not read, a camera file in its folder:

    CAMERA CAMERA-4f1c0a….toml, fitted above to 0.094 px rms, 0.688 px at most

The digits are those of the file's SHA-256: a damaged file is noticed, images with one camera share
it, and the bytes of the .SUM file determine the camera. Other programs leave the line out when they
write the .SUM file again; it then has the camera in its folder whose fit it has.
"""

from __future__ import annotations

import hashlib
import os
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from spcola import atomic
from spcola.camera import Camera
from spcola.camera.instrument import Instrument
from spcola.camera.owen_fit import CameraDifference, camera_difference, fit_owen
from spcola.errors import FormatError
from spcola.formats.cameras import camera_text, cameras_in
from spcola.formats.text import read_bytes
from spcola.formats.text.fields import Fields

__all__ = ["FIT_LIMIT_PX", "StoredCamera", "camera_files", "exact_cameras", "stored_camera"]

FIT_LIMIT_PX = 0.01
"""A camera whose largest difference from its fit is below this needs no file of its own."""

K_DECIMALS = 4
DISTORTION_DIGITS = 5
_PREFIX, _SUFFIX, _DIGITS = "CAMERA-", ".toml", 16
_KEYWORD = "CAMERA"
# Numbers of a .SUM file differ from those of the fit by no more than its rounding.
_ROUNDING = 1e-4


@dataclass(frozen=True, eq=False)
class StoredCamera:
    """A camera as a .SUM file and its camera file hold it.

    Parameters
    ----------
    exact : Camera
    fitted : Camera
        With Owen's distortion and the decimals of a .SUM file; `exact` itself if that is such a
        one.
    file : str
        Name of the camera file; empty if the fit is good enough.
    difference : CameraDifference
        Of the fit from the exact camera.
    """

    exact: Camera
    fitted: Camera
    file: str
    difference: CameraDifference

    def as_json(self) -> dict[str, Any]:
        """Return model, file and differences in JSON types."""
        return {
            "model": self.exact.distortion_model,
            "file": self.file,
            "rms_px": self.difference.rms_px,
            "largest_px": self.difference.largest_px,
        }

    @property
    def text(self) -> str:
        """How well .SUM files reproduce the camera, in words."""
        apart = self.difference
        return (
            f"its {self.exact.distortion_model} distortion is Owen's in .SUM files, fitted to "
            f"{apart.rms_px:.3g} px rms, {apart.largest_px:.3g} px at most"
        )

    @property
    def line(self) -> str:
        """The line of the .SUM file that names the camera file; empty without one."""
        if not self.file:
            return ""
        apart = self.difference
        return (
            f"{_KEYWORD} {self.file}, fitted above to {apart.rms_px:.3g} px rms, "
            f"{apart.largest_px:.3g} px at most\n"
        )


def stored_camera(camera: Camera) -> StoredCamera:
    """Return how a camera is kept in a .SUM file, and whether it needs a camera file.

    Raises
    ------
    InvalidValueError
        If its distortion folds over on most of its detector, or its coefficients are not those of
        its model.
    """
    if not camera.distortion.any():
        plain = camera
        if camera.distortion_model != "owen" or len(camera.distortion) != 4:
            plain = replace(camera, distortion_model="owen", distortion=np.zeros(4))
        return StoredCamera(camera, plain, "", CameraDifference(0.0, 0.0))
    if camera.distortion_model == "owen" and len(camera.distortion) == 4:
        return StoredCamera(camera, camera, "", CameraDifference(0.0, 0.0))
    return _stored(_text(camera))


def write_exact_camera(path: Path, stored: StoredCamera, like: Path | None = None) -> None:
    """Write the camera file of a .SUM file, if it needs one and it is not there.

    Parameters
    ----------
    path : Path
        The .SUM file.
    stored : StoredCamera
    like : Path, optional
        Another .SUM file; the camera file in its folder is linked, not written again.
    """
    target = path.parent / stored.file
    if not stored.file or target.is_file():
        return
    try:
        if like is None:
            raise FileNotFoundError
        os.link((like.parent / stored.file).resolve(), target)
    except OSError:
        atomic.write_text(target, _text(stored.exact))


def split_camera_line(lines: list[str]) -> tuple[list[str], str]:
    """Return the lines of a .SUM file without the last one that names a camera file, and the name.

    The name is empty if there is none.
    """
    end = len(lines)
    while end and not lines[end - 1].strip():
        end -= 1
    words = lines[end - 1].split() if end else []
    if len(words) < 2 or words[0] != _KEYWORD:
        return lines, ""
    return lines[: end - 1], words[1].rstrip(",")


def exact_camera(path: Path, fitted: Camera, name: str) -> Camera:
    """Return the camera of an image.

    Parameters
    ----------
    path : Path
        Its .SUM file.
    fitted : Camera
        As the .SUM file has it.
    name : str
        Of the camera file that it names; empty for none.

    Raises
    ------
    FormatError
        If the camera file is missing, damaged, or not that of these numbers.
    """
    if not name:
        return _camera_of_fit(path.parent, fitted)
    stored = read_exact_camera(path.parent / name, str(path))
    if not _same_numbers(stored.fitted, fitted):
        raise FormatError(
            f"its camera is not the fit to {name}, which it names",
            path,
            f"delete the line {_KEYWORD} if the numbers in the file are right",
        )
    return stored.exact


def read_exact_camera(path: Path, needed_by: str) -> StoredCamera:
    """Return the camera of a camera file that is named by its digest.

    Parameters
    ----------
    path : Path
    needed_by : str
        For messages.

    Raises
    ------
    FormatError
        If it is missing or damaged.
    """
    do = "bring it back, or import the image's state again"
    if not (path.name.startswith(_PREFIX) and path.name.endswith(_SUFFIX)):
        raise FormatError(f"names {path.name!r}, which is no name of a camera file", needed_by)
    if not path.is_file():
        raise FormatError(f"needs the exact camera {path}, which is not there", needed_by, do)
    content = read_bytes(path)
    if _name(content) != path.name:
        raise FormatError(f"is damaged, and the camera of {needed_by}", path, do)
    return _stored(content.decode("utf-8"))


def exact_cameras(summaries: Iterable[Path]) -> dict[str, StoredCamera]:
    """Return the camera files that .SUM files (`summaries`) name, by their names.

    Raises
    ------
    FormatError
        If one is missing or damaged.
    """
    found: dict[str, StoredCamera] = {}
    for path in summaries:
        tail = read_bytes(path).decode("ascii", errors="replace").splitlines()
        _, name = split_camera_line(tail)
        if name and name not in found:
            found[name] = read_exact_camera(path.parent / name, str(path))
    return found


def camera_files(folder: Path) -> list[Path]:
    """Return the camera files in a folder of .SUM files, in the order of their names."""
    return sorted(folder.glob(f"{_PREFIX}*{_SUFFIX}"))


def _camera_of_fit(folder: Path, fitted: Camera) -> Camera:
    """Return the camera in a folder whose fit this is; the fit itself if there is none."""
    try:
        there = _cameras_in(folder, folder.stat().st_mtime_ns)
    except OSError:
        return fitted
    return next((one.exact for one in there if _same_numbers(one.fitted, fitted)), fitted)


def _same_numbers(one: Camera, other: Camera) -> bool:
    """Return whether two cameras are equal but for rounding."""

    def numbers(camera: Camera) -> list[float]:
        return [camera.focal_length_mm, *camera.center, *camera.k_matrix.ravel()]

    if (one.width, one.height) != (other.width, other.height):
        return False
    return np.allclose(numbers(one), numbers(other), rtol=1e-9, atol=_ROUNDING) and np.allclose(
        one.distortion, other.distortion, rtol=_ROUNDING, atol=0.0
    )


@lru_cache(maxsize=8)
def _cameras_in(folder: Path, changed: int) -> tuple[StoredCamera, ...]:
    """Return the sound cameras of a folder as it was at a time: once for all its .SUM files."""
    del changed
    contents = [(path.name, read_bytes(path)) for path in camera_files(folder)]
    return tuple(_stored(text.decode()) for name, text in contents if _name(text) == name)


@lru_cache(maxsize=4096)
def _stored(text: str) -> StoredCamera:
    """Return how the camera of a camera file is kept; many images have the same."""
    (instrument,) = cameras_in(Fields(Path("camera file"), tomllib.loads(text))).values()
    exact = instrument.camera
    for whole in (False, True):
        fitted = _rounded(fit_owen(exact, whole=whole))
        if whole:
            # More decimals than SPC's columns have would move all that follows in the line.
            fitted = replace(fitted, k_matrix=np.round(fitted.k_matrix, K_DECIMALS) + 0.0)
        apart = camera_difference(exact, fitted)
        if apart.largest_px <= FIT_LIMIT_PX:
            return StoredCamera(exact, fitted, "", apart)
    return StoredCamera(exact, fitted, _name(text.encode("utf-8")), apart)


def _rounded(camera: Camera) -> Camera:
    """Return a camera with the decimals that a .SUM file has."""
    values = [float(f"{value:.{DISTORTION_DIGITS - 1}e}") for value in camera.distortion]
    return replace(camera, distortion=np.array(values))


def _text(camera: Camera) -> str:
    """Return the camera file of a camera."""
    return camera_text([Instrument("CAMERA", camera)])


def _name(content: bytes) -> str:
    return f"{_PREFIX}{hashlib.sha256(content).hexdigest()[:_DIGITS]}{_SUFFIX}"
