"""Cameras of COLMAP's binary models (``cameras.bin``).

Little-endian: the number of cameras (uint64), then for each its number and model (int32), width and
height (uint64) and the model's parameters (float64). COLMAP puts the upper left corner of the first
pixel at (0, 0), so that its centre is (0.5, 0.5); lengths are in pixels.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spcola.camera import Camera
from spcola.errors import FormatError
from spcola.formats.text import LARGEST_NUMBER, read_bytes


class _Model(NamedTuple):
    """Name of a model, number of its focal lengths (1 or 2), places of Brown's coefficients."""

    name: str
    focal: int
    places: tuple[int, ...]


_MODELS = {
    0: _Model("SIMPLE_PINHOLE", 1, ()),
    1: _Model("PINHOLE", 2, ()),
    2: _Model("SIMPLE_RADIAL", 1, (0,)),
    3: _Model("RADIAL", 1, (0, 1)),
    4: _Model("OPENCV", 2, (0, 1, 2, 3)),
    6: _Model("FULL_OPENCV", 2, (0, 1, 2, 3, 4, 5, 6, 7)),
}
_HEAD = struct.Struct("<iiQQ")
_LARGEST_SIDE = 1 << 24


def read_colmap_cameras(
    path: str | Path, *, pixel_mm: float = 0.01, first_pixel: float = 0.5
) -> dict[int, Camera]:
    """Read all cameras of ``cameras.bin``, by their numbers.

    Parameters
    ----------
    path : str or Path
    pixel_mm : float
        Size of a pixel. COLMAP has none, and projections do not depend on it.
    first_pixel : float
        Coordinate of the first pixel's centre: 0.5 by COLMAP's definition; 0 for models whose
        writer counted pixels from 0.

    Raises
    ------
    FormatError
        If the file ends early or goes on, or a model is not known.
    """
    content = read_bytes(path)
    if len(content) < 8:
        raise FormatError("is too short for COLMAP's cameras", path)
    (count,) = struct.unpack_from("<Q", content)
    cameras: dict[int, Camera] = {}
    place = 8
    for index in range(min(count, len(content))):
        where = f"{path}: camera {index + 1} of {count}"
        if place + _HEAD.size > len(content):
            raise FormatError("the file ends before it", where)
        number, kind, width, height = _HEAD.unpack_from(content, place)
        place += _HEAD.size
        model = _MODELS.get(kind)
        if model is None:
            known = ", ".join(one.name for one in _MODELS.values())
            raise FormatError(f"has model {kind}", where, f"{known} are read")
        length = model.focal + 2 + len(model.places)
        if place + 8 * length > len(content):
            raise FormatError("the file ends in its parameters", where)
        values = struct.unpack_from(f"<{length}d", content, place)
        place += 8 * length
        if number in cameras or not 0 < max(width, height) < _LARGEST_SIDE:
            raise FormatError(f"has number {number} again, or {width} × {height} pixels", where)
        size = (int(width), int(height))
        if not np.max(np.abs(values)) < LARGEST_NUMBER or min(values[: model.focal]) <= 0:
            raise FormatError("has a parameter that is no usable number", where)
        cameras[number] = _camera(model, values, size, pixel_mm, 1.0 - first_pixel)
    if place != len(content):
        raise FormatError(f"goes on for {len(content) - place} bytes after its cameras", path)
    return cameras


def _camera(
    model: _Model, values: tuple[float, ...], size: tuple[int, int], pixel_mm: float, shift: float
) -> Camera:
    """Return a camera of a model's parameters."""
    focal_x, focal_y = values[0], values[model.focal - 1]
    center = np.array(values[model.focal : model.focal + 2]) + shift
    coefficients = np.zeros(8 if len(model.places) > 4 else 4)
    coefficients[list(model.places)] = values[model.focal + 2 :]
    k_matrix = np.array([[1.0, 0.0, 0.0], [0.0, focal_y / focal_x, 0.0]]) / pixel_mm
    return Camera(focal_x * pixel_mm, center, k_matrix, *size, "brown", coefficients)
