"""Sigma companions of .MAP files: one 4-byte float for the height of each point."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError
from spcola.formats.text.source import KM, read_bytes

ORDERS = (">f4", "<f4")
"""Byte orders of sigma companions, the usual one first."""


def sigma_path(path: str | Path) -> Path:
    """Return the sigma companion's path: ``NAME.SIG`` next to ``NAME.MAP``."""
    return Path(path).with_suffix(".SIG")


def read_sigma(path: str | Path, half_size: int) -> FloatArray:
    """Read a sigma companion: one 4-byte float for each point, in the order of the .MAP file.

    Big-endian is the rule, but some builds write little-endian: the first byte order is used in
    which every value is NaN, 0, or between 1e-12 and 1e5 km.

    Parameters
    ----------
    path : str or Path
        File, in kilometres.
    half_size : int
        q of the maplet.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        Metres, indexed ``[m + q, n + q]``; NaN where unknown (stored NaN).

    Raises
    ------
    FormatError
        If the length contradicts q, or the values are absurd in either byte order.
    """
    content = read_bytes(path)
    size = 2 * half_size + 1
    if len(content) != 4 * size**2:
        raise FormatError(
            f"has {len(content)} bytes, {4 * size**2} belong to q = {half_size}", path
        )
    for order in ORDERS:
        sigma_km = np.frombuffer(content, order)
        if is_sigma_km(sigma_km):
            return sigma_km.astype(np.float64).reshape(size, size).T * KM
    raise FormatError("holds values that are no sigma in kilometres", path, "check its byte order")


def write_sigma(path: str | Path, sigma: FloatArray) -> None:
    """Write heights' sigma (2q+1, 2q+1), metres, as a big-endian companion in kilometres."""
    atomic.write_bytes(path, sigma_content(sigma))


def sigma_content(sigma: FloatArray) -> bytes:
    """Return the content that :func:`write_sigma` writes."""
    return (np.asarray(sigma).T / KM).astype(">f4").tobytes()


def is_sigma_km(values: AnyArray) -> bool:
    """Return whether every value is NaN (unknown), 0, or between 1e-12 and 1e5 km."""
    known = values[~np.isnan(values)].astype(np.float64)
    return bool(np.all((known == 0) | ((known >= 1e-12) & (known <= 1e5))))
