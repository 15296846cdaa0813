"""Sigma companions of .MAP files of what images show: albedo (.ASG) and slopes (.SSG)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import FloatArray
from spcola.errors import FormatError
from spcola.formats.text.source import read_bytes

__all__ = [
    "albedo_sigma_path",
    "read_albedo_sigma",
    "read_slope_sigma",
    "slope_sigma_path",
    "write_albedo_sigma",
    "write_slope_sigma",
]

_TYPE = ">f4"


def albedo_sigma_path(path: str | Path) -> Path:
    """Return the companion with the albedo's sigma: ``NAME.ASG`` next to ``NAME.MAP``.

    Parameters
    ----------
    path : str or Path
        Of the .MAP.
    """
    return Path(path).with_suffix(".ASG")


def slope_sigma_path(path: str | Path) -> Path:
    """Return the companion with the sigma of slopes: ``NAME.SSG`` next to ``NAME.MAP``.

    Parameters
    ----------
    path : str or Path
        Of the .MAP.
    """
    return Path(path).with_suffix(".SSG")


def read_albedo_sigma(path: str | Path, half_size: int) -> FloatArray:
    """Read the sigma of the albedo of a .MAP: one big-endian 4-byte float for each point.

    Parameters
    ----------
    path : str or Path
        ``NAME.ASG``.
    half_size : int
        q of the maplet.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        In the albedo's own numbers, indexed ``[m + q, n + q]``; NaN where no image determines the
        albedo, for which a .MAP has no mark.

    Raises
    ------
    FormatError
        If the length contradicts q, or a value is negative or infinite.
    """
    (sigma,) = _read(path, half_size, (1, 2 * half_size + 1), "an albedo")
    return sigma


def write_albedo_sigma(path: str | Path, sigma: FloatArray) -> None:
    """Write the sigma of the albedo of a .MAP, as :func:`read_albedo_sigma` reads it.

    Parameters
    ----------
    path : str or Path
        Of the .MAP; the companion is written next to it.
    sigma : (2q+1, 2q+1) ndarray
        NaN where unknown.
    """
    _write(albedo_sigma_path(path), np.asarray(sigma)[None])


def read_slope_sigma(path: str | Path, half_size: int) -> FloatArray:
    """Read the sigmas of the slopes of a .MAP: two big-endian 4-byte floats for each cell.

    Parameters
    ----------
    path : str or Path
        ``NAME.SSG``: all cells of ∂h/∂x, then all of ∂h/∂y, each in the order of the .MAP file.
    half_size : int
        q of the maplet.

    Returns
    -------
    (2, 2q, 2q) ndarray
        Tangents, of ∂h/∂x and ∂h/∂y; of the cell between the points ``[i, j]`` and
        ``[i + 1, j + 1]``. NaN where one of its four heights is unknown.

    Raises
    ------
    FormatError
        If the length contradicts q, or a value is negative or infinite.
    """
    return _read(path, half_size, (2, 2 * half_size), "slopes")


def write_slope_sigma(path: str | Path, sigma: FloatArray) -> None:
    """Write the sigmas of the slopes of a .MAP, as :func:`read_slope_sigma` reads them.

    Parameters
    ----------
    path : str or Path
        Of the .MAP; the companion is written next to it.
    sigma : (2, 2q, 2q) ndarray
        Of ∂h/∂x and ∂h/∂y of cells, as tangents; NaN where unknown.
    """
    _write(slope_sigma_path(path), np.asarray(sigma))


def _read(path: str | Path, half_size: int, shape: tuple[int, int], what: str) -> FloatArray:
    """Return layers of squares (layers, size), as they are written."""
    content = read_bytes(path)
    layers, size = shape
    expected = np.dtype(_TYPE).itemsize * layers * size**2
    if len(content) != expected:
        raise FormatError(f"has {len(content)} bytes, {expected} belong to q = {half_size}", path)
    values = np.frombuffer(content, _TYPE).astype(np.float64)
    if np.isinf(values).any() or (values < 0.0).any():
        raise FormatError(f"holds values that are no sigma of {what}", path)
    return values.reshape(layers, size, size).transpose(0, 2, 1)


def _write(path: Path, layers: FloatArray) -> None:
    # The fast index runs along Uy, as in the .MAP.
    atomic.write_bytes(path, layers.transpose(0, 2, 1).astype(_TYPE).tobytes())
