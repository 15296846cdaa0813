"""Companion of .MAP files: in how many directions images determine the slope of each cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError
from spcola.formats.text.source import read_bytes

__all__ = [
    "SlopeDirections",
    "read_slope_directions",
    "slope_directions_path",
    "write_slope_directions",
]

_TYPE = ">f4"


@dataclass(frozen=True, eq=False)
class SlopeDirections:
    """Which slopes of the cells of a maplet images determine.

    Attributes
    ----------
    count : (2q, 2q) ndarray of int8
        In how many directions: 0, 1 or 2; of the cell between the points ``[i, j]`` and
        ``[i + 1, j + 1]``.
    undetermined_azimuth_deg : (2q, 2q) ndarray
        Of cells with one direction the axis along which the slope is not determined; across it, it
        is. In the plane of the maplet, from north (the body-fixed +Z in that plane) towards east, 0
        to 180 degrees; NaN for other cells.
    """

    count: AnyArray
    undetermined_azimuth_deg: FloatArray

    @property
    def count_at_points(self) -> AnyArray:
        """Fewest directions of the cells around each point, (2q+1, 2q+1) ndarray of int8."""
        around = np.pad(self.count, 1, constant_values=2)
        columns = np.minimum(around[:, 1:], around[:, :-1])
        fewest: AnyArray = np.minimum(columns[1:], columns[:-1])
        return fewest


def slope_directions_path(path: str | Path) -> Path:
    """Return the companion with the directions of slopes: ``NAME.SDR`` next to ``NAME.MAP``.

    Parameters
    ----------
    path : str or Path
        Of the .MAP.
    """
    return Path(path).with_suffix(".SDR")


def read_slope_directions(path: str | Path, half_size: int) -> SlopeDirections:
    """Read which slopes of a .MAP images determine: two big-endian 4-byte floats for each cell.

    Parameters
    ----------
    path : str or Path
        ``NAME.SDR``: the number of directions of all cells, then the azimuths of all, each in the
        order of the .MAP file.
    half_size : int
        q of the maplet.

    Raises
    ------
    FormatError
        If the length contradicts q, a number is none of 0, 1 and 2, or there is an azimuth outside
        0 to 180° or elsewhere than in cells with one direction.
    """
    content, size = read_bytes(path), 2 * half_size
    expected = 2 * np.dtype(_TYPE).itemsize * size**2
    if len(content) != expected:
        raise FormatError(f"has {len(content)} bytes, {expected} belong to q = {half_size}", path)
    layers = np.frombuffer(content, _TYPE).reshape(2, size, size).transpose(0, 2, 1)
    count, azimuth = layers.astype(np.float64)
    if not np.isin(count, (0.0, 1.0, 2.0)).all():
        raise FormatError("has a number of directions that is none of 0, 1 and 2", path)
    known = np.isfinite(azimuth)
    if (known != (count == 1.0)).any() or not ((azimuth >= 0.0) & (azimuth <= 180.0))[known].all():
        raise FormatError("has azimuths that do not belong to cells with one direction", path)
    return SlopeDirections(count.astype(np.int8), azimuth)


def write_slope_directions(path: str | Path, found: SlopeDirections) -> None:
    """Write which slopes of a .MAP images determine, as :func:`read_slope_directions` reads it.

    Parameters
    ----------
    path : str or Path
        Of the .MAP; the companion is written next to it.
    found : SlopeDirections
    """
    layers = np.stack([found.count, found.undetermined_azimuth_deg])
    # The fast index runs along Uy, as in the .MAP.
    content = layers.transpose(0, 2, 1).astype(_TYPE).tobytes()
    atomic.write_bytes(slope_directions_path(path), content)
