"""Maplets and bigmaps as .MAP files: a header record of 72 bytes, then heights and albedo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from spcola import atomic
from spcola.arrays import AnyArray, FloatArray
from spcola.errors import FormatError, InvalidValueError
from spcola.formats.source import KM, check_grid_km, read_bytes
from spcola.maplet import Maplet, MapletGrid

RECORD = 72

_HEADER = np.dtype(
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
_NODE = np.dtype([("height", ">i2"), ("albedo", "u1")])


@dataclass(frozen=True)
class MapHeader:
    """What a .MAP file holds beside the maplet: kept so that an untouched file is rewritten alike.

    Parameters
    ----------
    leading : bytes
        Bytes 1-6, unused by SPC (some writers sign here).
    version : int
        Signed version byte: 0 Gaskell, above 0 SPC, below 0 OLA.
    hscale : float, optional
        Height quantum in units of the GSD; used again only while it still reproduces every
        height, otherwise a new one is chosen. ``None`` chooses one.
    sigma_direction : bytes
        Direction of the position uncertainty, each byte / 255.
    sigma_size_km : float
        Its magnitude.
    hidden_counts : bytes
        Height counts of the file in its own order, kept only if a missing point has one.
    padding : bytes
        What follows the last grid point, kept only if it is not all zero.
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


@dataclass(frozen=True, eq=False)
class MapFile:
    """A maplet with the header of the file that it came from."""

    maplet: Maplet
    header: MapHeader


def map_length(half_size: int) -> int:
    """Length in bytes of a .MAP file of half-size q: 72 (1 + ceil(3 (2q+1)² / 72))."""
    return RECORD * (1 - (-3 * (2 * half_size + 1) ** 2 // RECORD))


def read_map(path: str | Path, *, name: str | None = None) -> MapFile:
    """Read a .MAP file with its header.

    The file's slow index j runs along Ux and its fast index i along Uy; the maplet's arrays are
    indexed ``[m + q, n + q]`` (rows along Uy), so the data are transposed. A point whose albedo
    byte is 0 is missing: its height and albedo are NaN.

    Parameters
    ----------
    path : str or Path
        The file; kilometres inside, metres in what is returned.
    name : str, optional
        Name of the maplet; the stem of the file's name if not given.

    Raises
    ------
    FormatError
        If the file is truncated, its length contradicts q, or a field of the header is absurd;
        the bytes are named.
    """
    content = read_bytes(path)
    if len(content) < RECORD:
        raise FormatError(f"is truncated: {len(content)} bytes, the header has {RECORD}", path)
    record = np.frombuffer(content, _HEADER, count=1)[0]
    _check_length(content, int(record["half_size"]), path)
    grid = _grid(record, path)
    header, center_sigma = _header(record, path)
    nodes = np.frombuffer(content, _NODE, count=grid.size**2, offset=RECORD)
    missing = nodes["albedo"] == 0
    counts = np.where(missing, np.nan, nodes["height"])
    quantum = grid.gsd * float(record["hscale"])
    albedo = np.where(missing, np.nan, nodes["albedo"] / 100.0)
    maplet = Maplet(
        Path(path).stem if name is None else name,
        grid,
        (counts * quantum).reshape(grid.shape).T,
        albedo.reshape(grid.shape).T,
        center_sigma=center_sigma,
    )
    padding = content[RECORD + nodes.nbytes :]
    hidden = nodes["height"].tobytes() if nodes["height"][missing].any() else b""
    kept = MapHeader(
        header.leading,
        header.version,
        float(record["hscale"]),
        header.sigma_direction,
        header.sigma_size_km,
        hidden,
        padding if any(padding) else b"",
    )
    return MapFile(maplet, kept)


def read_maplet(path: str | Path, *, name: str | None = None) -> Maplet:
    """Read a .MAP file, and the sigma companion ``NAME.SIG`` beside it if there is one.

    Raises
    ------
    FormatError
        As :func:`read_map` and :func:`read_sigma`.
    """
    maplet = read_map(path, name=name).maplet
    companion = sigma_path(path)
    if not companion.exists():
        return maplet
    return maplet.with_layers(sigma=read_sigma(companion, maplet.grid.half_size))


def write_maplet(
    path: str | Path,
    maplet: Maplet,
    *,
    header: MapHeader | None = None,
    sigma_companion: bool = False,
) -> None:
    """Write a maplet or bigmap as a .MAP file.

    Heights are stored as 16-bit counts of ``hscale`` times the GSD. The header's hscale is kept
    while it reproduces the heights; otherwise it is max(1, max|h|) / 30000, h in units of the
    GSD, so that no height can overflow. Albedo is stored in hundredths, 0.01 … 2.55 (values
    beyond are clipped; a valid point is never given byte 0, which means missing); an unknown
    albedo at a valid point is stored as 1. An unknown position uncertainty is stored as 0.

    Parameters
    ----------
    path : str or Path
        Written whole or not at all.
    maplet : Maplet
        Metres.
    header : MapHeader, optional
        What :func:`read_map` found, to be kept.
    sigma_companion : bool
        Also write the heights' sigma to ``NAME.SIG`` beside it.

    Raises
    ------
    InvalidValueError
        If the frame does not fit the format (q above 65535, |V|, GSD; see
        :func:`spcola.formats.source.check_grid_km`), or a height exceeds 3e8 GSD.
    WorkspaceError
        If the file cannot be written.
    """
    header = header or MapHeader()
    grid = maplet.grid
    if grid.half_size > 65535:
        raise InvalidValueError(f"half-size {grid.half_size} exceeds 65535", maplet.name)
    check_grid_km(grid.center / KM, grid.gsd / KM, grid.half_size)
    record = np.zeros(1, _HEADER)
    record["leading"] = np.frombuffer(header.leading, "V6")
    record["gsd"] = grid.gsd / KM
    record["half_size"] = grid.half_size
    record["center"] = grid.center / KM
    record["axes"] = grid.axes
    record["version"] = header.version
    _store_center_sigma(record, maplet, header)
    heights = maplet.height.T.ravel() / (float(record["gsd"][0]) * KM)
    record["hscale"] = _hscale(heights, header.hscale, maplet.name)
    nodes = _nodes(heights / float(record["hscale"][0]), maplet, header)
    body = record.tobytes() + nodes.tobytes()
    room = map_length(grid.half_size) - len(body)
    padding = header.padding if len(header.padding) == room else bytes(room)
    atomic.write_bytes(path, body + padding)
    if sigma_companion:
        write_sigma(sigma_path(path), maplet.sigma)


def sigma_path(path: str | Path) -> Path:
    """Return the sigma companion's path: ``NAME.SIG`` beside ``NAME.MAP``."""
    return Path(path).with_suffix(".SIG")


def read_sigma(
    path: str | Path, half_size: int, *, byte_order: Literal[">", "<"] | None = None
) -> FloatArray:
    """Read a sigma companion: one 4-byte float for each point, in the order of the .MAP file.

    Parameters
    ----------
    path : str or Path
        Kilometres inside.
    half_size : int
        q of the maplet.
    byte_order : {">", "<"}, optional
        Big-endian is the rule, but some builds write little-endian; if not given, the order in
        which every value is NaN, 0, or between 1e-12 and 1e5 km is taken, big-endian first.

    Returns
    -------
    (2q+1, 2q+1) ndarray
        Metres, indexed ``[m + q, n + q]``; NaN where not known (stored NaN).

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
    orders: tuple[Literal[">", "<"], ...] = (byte_order,) if byte_order else (">", "<")
    for order in orders:
        sigma_km = np.frombuffer(content, np.dtype("f4").newbyteorder(order))
        if _is_sigma_km(sigma_km):
            return sigma_km.astype(np.float64).reshape(size, size).T * KM
    raise FormatError("holds values that are no sigma in kilometres", path, "check its byte order")


def write_sigma(path: str | Path, sigma: FloatArray) -> None:
    """Write heights' sigma (2q+1, 2q+1), metres, as a big-endian companion in kilometres.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    atomic.write_bytes(path, (np.asarray(sigma).T / KM).astype(">f4").tobytes())


def _is_sigma_km(values: AnyArray) -> bool:
    """Whether every value is NaN (unknown), 0, or between 1e-12 and 1e5 km."""
    known = values[~np.isnan(values)].astype(np.float64)
    return bool(np.all((known == 0) | ((known >= 1e-12) & (known <= 1e5))))


def _check_length(content: bytes, half_size: int, path: str | Path) -> None:
    """Refuse a file whose length is not that of its q, and say so if q looks byte-swapped."""
    place = f"{path}, bytes 11-12 (q)"
    if len(content) == map_length(half_size) and half_size >= 1:
        return
    swapped = int.from_bytes(half_size.to_bytes(2, "little"), "big")
    if swapped >= 1 and len(content) == map_length(swapped):
        raise FormatError(
            f"q is byte-swapped: it reads {half_size}, the other byte order gives {swapped}, "
            "which fits the file's length",
            place,
            "write q least significant byte first",
        )
    if half_size < 1:
        raise FormatError("q is 0: a maplet has at least 3 × 3 points", place)
    wanted = map_length(half_size)
    problem = "is truncated" if len(content) < wanted else "is too long"
    raise FormatError(
        f"q = {half_size} needs {wanted} bytes, the file has {len(content)}: it {problem}, "
        "or q is mis-declared",
        place,
    )


def _grid(record: AnyArray, path: str | Path) -> MapletGrid:
    """Return the frame that the header describes, or say which bytes are absurd."""
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


def _header(record: AnyArray, path: str | Path) -> tuple[MapHeader, FloatArray]:
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
    sigma: FloatArray = direction / 255.0 * size_km * KM
    return sigma


def _store_center_sigma(record: AnyArray, maplet: Maplet, header: MapHeader) -> None:
    """Store sigma of V: the header's own bytes if they say the same, else new ones."""
    stored = np.frombuffer(header.sigma_direction, np.uint8)
    sigma = maplet.center_sigma
    size = float(np.linalg.norm(sigma))
    if np.array_equal(_center_sigma(stored, header.sigma_size_km), sigma, equal_nan=True):
        record["sigma_direction"] = stored
        record["sigma_size"] = header.sigma_size_km
    elif np.isfinite(size) and size > 0:
        record["sigma_direction"] = np.rint(255.0 * sigma / size)
        record["sigma_size"] = size / KM


def _hscale(heights: FloatArray, kept: float | None, name: str) -> float:
    """Return the height quantum for `heights` (N,), units of GSD (NaN: missing)."""
    largest = float(np.nanmax(np.abs(heights), initial=0.0))
    if kept is not None and kept > 0:
        counts = heights[np.isfinite(heights)] / kept
        # Half a thousandth of a count: what the rounding of GSD and hscale to 4 bytes can do to
        # a count that was an integer, with room; a height that was changed is not that close.
        exact = np.all(np.abs(counts - np.rint(counts)) < 5e-4)
        if exact and largest <= 32767 * kept:
            return kept
    if largest > 30000.0 * _LARGEST_HSCALE:
        raise InvalidValueError(f"holds a height of {largest:.6g} GSD: is it in metres?", name)
    return max(1.0, largest) / 30000.0


def _nodes(counts: FloatArray, maplet: Maplet, header: MapHeader) -> AnyArray:
    """Return the grid points as the file stores them, from height counts in its order."""
    missing = np.isnan(counts)
    nodes = np.zeros(len(counts), _NODE)
    hidden = np.frombuffer(header.hidden_counts, ">i2")
    nodes["height"] = np.where(
        missing, hidden if len(hidden) == len(counts) else 0, np.rint(np.nan_to_num(counts))
    )
    albedo = np.nan_to_num(maplet.albedo.T.ravel(), nan=1.0, posinf=2.55, neginf=0.01)
    nodes["albedo"] = np.where(missing, 0, np.clip(np.rint(albedo * 100.0), 1, 255))
    return nodes
