"""The header record of .MAP files: frame, height quantum, position uncertainty, version."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.text.source import KM, check_grid_km
from spcola.grids import Maplet, MapletGrid

RECORD = 72

HEADER = np.dtype(
    [
        ("leading", "V6"),
        ("gsd", ">f4"),
        ("half_size", "<u2"),
        ("sigma_direction", "u1", 3),
        ("center", ">f4", 3),
        ("axes", ">f4", (3, 3)),
        ("hscale", ">f4"),
        ("sigma_size", ">f4"),
        ("version", "i1"),
    ]
)
_BYTES = {
    "GSD": "bytes 7-10 (GSD)",
    "V": "bytes 16-27 (V)",
    "center": "bytes 16-27 (V)",
    "axes": "bytes 28-63 (Ux, Uy, Uz)",
}
_SMALLEST_HSCALE, _LARGEST_HSCALE = 1e-12, 1e4


@dataclass(frozen=True)
class MapHeader:
    """Content of a .MAP header beyond the maplet, kept so that a file is rewritten unchanged.

    Parameters
    ----------
    leading : bytes
        Bytes 1-6, unused by SPC (some writers sign here).
    version : int
        Signed version byte: 0 Gaskell, above 0 SPC, below 0 OLA.
    hscale : float, optional
        Height quantum in units of the GSD; used again while it reproduces every height, otherwise
        a new one is chosen.
    sigma_direction : bytes
        Direction of the position uncertainty, each byte / 255.
    sigma_size_km : float
        Its magnitude.
    hidden_counts : bytes
        Height counts of the file in its own order, kept only if a missing point has one.
    padding : bytes
        Bytes after the last grid point, kept only if not all zero.
    """

    leading: bytes = bytes(6)
    version: int = 0
    hscale: float | None = None
    sigma_direction: bytes = bytes(3)
    sigma_size_km: float = 0.0
    hidden_counts: bytes = b""
    padding: bytes = b""

    def __post_init__(self) -> None:
        if len(self.leading) != 6 or len(self.sigma_direction) != 3:
            raise InvalidValueError("needs 6 leading and 3 direction bytes", ".MAP header")
        if not -128 <= self.version <= 127:
            raise InvalidValueError(f"{self.version} is not in −128 … 127", ".MAP version")


def map_length(half_size: int) -> int:
    """Length in bytes of a .MAP file of q = `half_size`: 72 (1 + ceil(3 (2q+1)² / 72))."""
    return RECORD * (1 - (-3 * (2 * half_size + 1) ** 2 // RECORD))


def check_length(length: int, half_size: int, path: str | Path) -> None:
    """Refuse a file whose length is not that of its q; detect a byte-swapped q."""
    place = f"{path}, bytes 11-12 (q)"
    if length == map_length(half_size) and half_size >= 1:
        return
    swapped = int.from_bytes(half_size.to_bytes(2, "little"), "big")
    if swapped >= 1 and length == map_length(swapped):
        raise FormatError(
            f"q is byte-swapped: it reads {half_size}, the other byte order gives {swapped}, "
            "which fits the file's length",
            place,
            "write q least significant byte first",
        )
    if half_size < 1:
        raise FormatError("q is 0: a maplet has at least 3 × 3 points", place)
    wanted = map_length(half_size)
    problem = "is truncated" if length < wanted else "is too long"
    raise FormatError(
        f"q = {half_size} needs {wanted} bytes, the file has {length}: it {problem}, "
        "or q is mis-declared",
        place,
    )


def grid_of(record: AnyArray, path: str | Path) -> MapletGrid:
    """Return the frame in the header, or an error that names the absurd bytes."""
    fields = [record["gsd"], *record["center"], *record["axes"].ravel()]
    if not np.all(np.isfinite(fields)):
        raise FormatError("GSD, V or an axis is not a finite number", f"{path}, bytes 7-63")
    gsd_km = float(record["gsd"])
    center_km = record["center"].astype(np.float64)
    half_size = int(record["half_size"])
    try:
        check_grid_km(center_km, gsd_km, half_size)
        return MapletGrid(center_km * KM, record["axes"].astype(float), gsd_km * KM, half_size)
    except InvalidValueError as error:
        place = _BYTES.get(error.where or "", "header")
        swapped = float(record["gsd"].byteswap())
        if place == _BYTES["GSD"] and 1e-9 <= swapped <= 100.0:
            advice = f"it may be byte-swapped ({swapped:.6g} km the other way round)"
        else:
            advice = error.do or "the file is damaged or not a .MAP file"
        raise FormatError(f"{error.where} {error.what}", f"{path}, {place}", advice) from error


def header_of(record: AnyArray, path: str | Path) -> tuple[MapHeader, FloatArray]:
    """Return the rest of the header, and sigma of V (3,), metres (NaN if not given)."""
    hscale = float(record["hscale"])
    if not _SMALLEST_HSCALE <= hscale <= _LARGEST_HSCALE:
        raise FormatError(
            f"hscale {hscale:.6g} is not between {_SMALLEST_HSCALE:g} and {_LARGEST_HSCALE:g}",
            f"{path}, bytes 64-67 (hscale)",
        )
    size_km = float(record["sigma_size"])
    if not 0.0 <= size_km <= 1e5:
        raise FormatError(
            f"position uncertainty {size_km:.6g} km is not between 0 and 1e5 km",
            f"{path}, bytes 68-71 (uncertainty)",
        )
    direction = record["sigma_direction"]
    header = MapHeader(
        record["leading"].tobytes(),
        int(record["version"]),
        hscale,
        direction.tobytes(),
        size_km,
    )
    return header, _center_sigma(direction, size_km)


def _center_sigma(direction: AnyArray, size_km: float) -> FloatArray:
    """Return sigma of V (3,), metres: NaN where the file gives none (magnitude 0)."""
    if size_km == 0.0:
        return np.full(3, np.nan)
    return direction / 255.0 * size_km * KM


def encode_header(maplet: Maplet, header: MapHeader) -> AnyArray:
    """Return the header record (1,) of `maplet`, without its hscale.

    An InvalidValueError if the frame does not fit the format.
    """
    grid = maplet.grid
    if grid.half_size > 65535:
        raise InvalidValueError(f"half-size {grid.half_size} exceeds 65535", maplet.name)
    check_grid_km(grid.center / KM, grid.gsd / KM, grid.half_size)
    record = np.zeros(1, HEADER)
    record["leading"] = np.frombuffer(header.leading, "V6")
    record["gsd"] = grid.gsd / KM
    record["half_size"] = grid.half_size
    record["center"] = grid.center / KM
    record["axes"] = grid.axes
    record["version"] = header.version
    _store_center_sigma(record, maplet.center_sigma, header)
    return record


def _store_center_sigma(record: AnyArray, sigma: FloatArray, header: MapHeader) -> None:
    """Store sigma of V: the header's own bytes if they decode to it, else new ones."""
    stored = np.frombuffer(header.sigma_direction, np.uint8)
    size = float(np.linalg.norm(sigma))
    if np.array_equal(_center_sigma(stored, header.sigma_size_km), sigma, equal_nan=True):
        record["sigma_direction"] = stored
        record["sigma_size"] = header.sigma_size_km
    elif np.isfinite(size) and size > 0:
        record["sigma_direction"] = np.rint(255.0 * sigma / size)
        record["sigma_size"] = size / KM


def choose_hscale(heights: FloatArray, kept: float | None, name: str) -> float:
    """Return the height quantum for `heights` (N,), units of GSD (NaN: missing)."""
    largest = float(np.nanmax(np.abs(heights), initial=0.0))
    if kept is not None and kept > 0:
        counts = heights[np.isfinite(heights)] / kept
        # Half a thousandth of a count: above the effect of rounding GSD and hscale to 4 bytes on
        # an integer count; a changed height is not that close.
        exact = np.all(np.abs(counts - np.rint(counts)) < 5e-4)
        if exact and largest <= 32767 * kept:
            return kept
    if largest > 30000.0 * _LARGEST_HSCALE:
        raise InvalidValueError(f"holds a height of {largest:.6g} GSD: is it in metres?", name)
    return max(1.0, largest) / 30000.0
