"""States of line-scan images: an HDF5 file for each, as .SUM files have one state only.

Datasets ``times`` (L,), ephemeris time of the middle of each line, s; ``positions`` (L, 3) of the
pupil, body-fixed, metres; ``axes`` (L, 3, 3), rows Cx, Cy, Cz, body-fixed; ``sun`` (3,). Attributes
``name``, ``shutter``, ``thresholds``, ``camera`` (a camera file), and ``digest``, the SHA-256 of
all of them: a damaged file is noticed.
"""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path

import numpy as np

from spcola.camera.instrument import Instrument
from spcola.camera.linescan import LineScan, LineScanImage
from spcola.errors import FormatError
from spcola.formats.cameras import camera_text, cameras_in
from spcola.formats.hdf5 import read_layer, read_text, reading_hdf5, replacing_hdf5, stored
from spcola.formats.text.fields import Fields
from spcola.formats.text.source import check_name

__all__ = ["LINE_SCAN_SUFFIX", "is_line_scan", "read_line_scan", "write_line_scan"]

_FORM = "spcola line scan 1"
LINE_SCAN_SUFFIX = ".h5"
_ARRAYS = {"times": (None,), "positions": (None, 3), "axes": (None, 3, 3), "sun": (3,)}
_TEXTS = ("name", "shutter", "camera", "thresholds")
_DO = "bring the file back, or import the image's states again"


def write_line_scan(path: str | Path, image: LineScanImage) -> None:
    """Write the states of a line-scan image; all digits are kept.

    Parameters
    ----------
    path : str or Path
    image : LineScanImage

    Raises
    ------
    InvalidValueError
        If its name is too long.
    WorkspaceError
        If the file cannot be written.
    """
    scan = image.scan
    arrays = {
        "times": scan.times, "positions": scan.positions, "axes": scan.axes, "sun": image.sun,
    }  # fmt: skip
    texts = {
        "name": check_name(image.name, "image", path),
        "shutter": scan.shutter,
        "camera": camera_text([Instrument("CAMERA", scan.camera)]),
        "thresholds": f"{image.thresholds[0]} {image.thresholds[1]}",
    }
    with replacing_hdf5(path) as file:
        for name, values in arrays.items():
            file[name] = np.asarray(values, dtype="<f8")
        for name, text in texts.items():
            file.attrs[name] = stored(text)
        file.attrs["format"] = stored(_FORM)
        file.attrs["digest"] = stored(_digest(arrays, texts))


def is_line_scan(path: str | Path) -> bool:
    """Return whether the file at `path` is one of a line-scan image."""
    try:
        with reading_hdf5(path, _FORM, "is damaged", _DO):
            return True
    except FormatError:
        return False


def read_line_scan(path: str | Path) -> LineScanImage:
    """Read the states of a line-scan image from the file at `path`.

    Raises
    ------
    FormatError
        If the file cannot be read, is damaged, or of another form.
    """
    with reading_hdf5(path, _FORM, "is damaged", _DO) as file:
        arrays = {
            name: np.asarray(read_layer(file, name, shape), dtype=np.float64)
            for name, shape in _ARRAYS.items()
        }
        texts = {name: read_text(file, name) for name in _TEXTS}
        digest = read_text(file, "digest")
        if digest != _digest(arrays, texts):
            raise FormatError("is damaged: its content has another digest", path, _DO)
        fields = Fields(Path(path), tomllib.loads(texts["camera"]))
        (instrument,) = cameras_in(fields).values()
        low, high = (int(word) for word in texts["thresholds"].split())
        scan = LineScan(
            instrument.camera, arrays["times"], arrays["positions"], arrays["axes"],
            texts["shutter"],  # type: ignore[arg-type]  # sealed as it was written
        )  # fmt: skip
        return LineScanImage(texts["name"], scan, arrays["sun"], (low, high))


def _digest(arrays: dict[str, np.ndarray], texts: dict[str, str]) -> str:
    """Return the SHA-256 of all that a file has, hexadecimal."""
    digest = hashlib.sha256()
    for name in _ARRAYS:
        digest.update(f"{name} {arrays[name].shape}".encode())
        digest.update(np.ascontiguousarray(arrays[name], dtype="<f8").tobytes())
    for name in _TEXTS:
        digest.update(f"{name} {texts[name]}".encode())
    return digest.hexdigest()
