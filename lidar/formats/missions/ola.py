"""OLA level 2: 186-byte little-endian records of the OSIRIS-REx laser altimeter, no header."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar.formats.records.binary import check_whole, mapped_chunks, probed
from lidar.formats.records.options import LidarOptions
from lidar.formats.records.screening import Agreement, Records, Screen, norms
from lidar.scans import Scan
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.atomic import replacing
from spcola.compilation import compiled
from spcola.errors import FormatError
from spcola.navigation import iso_utc

OLA_RECORD = np.dtype(
    [
        ("met", "S18"),
        ("met_offset", "<f8"),
        ("utc", "S24"),
        ("et", "<f8"),
        ("scan_ola_time", "<f8"),
        ("power_cycle", "<i2"),
        ("laser_selection", "<i2"),
        ("scan_mode", "<i2"),
        ("flag_status", "<i2"),
        ("range_mm", "<f8"),
        ("azimuth_mrad", "<f8"),
        ("elevation_mrad", "<f8"),
        ("intensity_t0", "<f8"),
        ("intensity_trr", "<f8"),
        ("xyz", "<f8", (3,)),
        ("elongitude_deg", "<f8"),
        ("latitude_deg", "<f8"),
        ("radius_km", "<f8"),
        ("scxyz", "<f8", (3,)),
    ]
)
"""The 23 fields of a record (x, y, z and scx, scy, scz are each one triple here)."""

_OLD_SIZE = 144
_DEGREE = np.pi / 180.0
_TIME_TEXT = re.compile(rb"\d{4}[- ]\w{2,3}[-T ]\d{2}")
_REASONS = {1: "overflow", 2: "no return", 3: "missing"}

# The range is counted from another point than the spacecraft position, 1.05 to 1.25 m away.
# The tolerance accepts simulated tables without that offset, and no garbled record.
_AGREEMENT = Agreement(offset_m=1.15, tolerance_m=2.0)


def is_ola(path: Path, size: int) -> bool:
    """Return whether a file has OLA records: whole, cut off, byte-swapped or of the old size."""
    swapped = OLA_RECORD.newbyteorder()
    return _sound(path, size, OLA_RECORD) or _sound(path, size, swapped) or _is_old(path, size)


def read_ola(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the valid returns of an OLA level-2 file in chunks.

    Valid is flag mod 100 = 0 (the hundred means that the demodulator was on). Returns without
    echo have a range of about −1128.92 mm and a position near the spacecraft: no range that is
    not positive becomes a point.

    Raises
    ------
    FormatError
        If the file is byte-swapped, cut off within a record, has the old 144-byte records, or
        contradicts itself.
    """
    size = path.stat().st_size
    _check_layout(path, size)
    screen = Screen(path, _AGREEMENT, options)
    for table in mapped_chunks(path, OLA_RECORD, size // OLA_RECORD.itemsize, options.chunk):
        yield screen.scan(_records(table))


def write_ola(path: str | Path, chunks: Iterable[Scan]) -> None:
    """Write scans as one OLA level-2 file, whole or not at all.

    Unknown values are written as NaN, blank, or −1 in the integer fields. Returns keep their
    flag.

    Parameters
    ----------
    path : str or Path
    chunks : iterable of Scan
        Written in their order.

    Raises
    ------
    WorkspaceError
        If the file cannot be written.
    """
    with replacing(path) as temporary, temporary.open("wb") as stream:
        for scan in chunks:
            stream.write(_table(scan).view(np.uint8).data)


def _records(table: NDArray[Any]) -> Records:
    count = len(table)
    points, spacecraft, spherical = (np.empty((count, 3)) for _ in range(3))
    ranges, time, intensity = (np.empty(count) for _ in range(3))
    flag = np.empty(count, dtype=np.int16)
    _split(table, points, spacecraft, spherical, ranges, time, intensity, flag)
    return Records(
        points=points,
        spacecraft=spacecraft,
        range=ranges,
        spherical=spherical,
        time=time,
        intensity=intensity,
        flag=flag,
        refused=_refused(flag),
    )


@compiled
def _split(
    table: NDArray[Any],
    points: FloatArray,
    spacecraft: FloatArray,
    spherical: FloatArray,
    ranges: FloatArray,
    time: FloatArray,
    intensity: FloatArray,
    flag: AnyArray,
) -> None:
    """Write the fields of records into layers, SI units, in one pass over the table."""
    for n in range(len(table)):
        record = table[n]
        for axis in range(3):
            points[n, axis] = record.xyz[axis]
            spacecraft[n, axis] = record.scxyz[axis]
        spherical[n, 0] = record.elongitude_deg * _DEGREE
        spherical[n, 1] = record.latitude_deg * _DEGREE
        spherical[n, 2] = record.radius_km * 1e3
        ranges[n] = record.range_mm * 1e-3
        time[n] = record.et
        intensity[n] = record.intensity_trr
        flag[n] = record.flag_status


def _refused(flag: AnyArray) -> dict[str, BoolArray]:
    if not flag.any():
        return {}
    kind = flag % 100
    refused = {reason: kind == code for code, reason in _REASONS.items()}
    refused["unknown flag"] = kind > max(_REASONS)
    return refused


def _check_layout(path: Path, size: int) -> None:
    """Refuse a file whose bytes are not whole little-endian records of 186 bytes."""
    if size == 0:
        raise FormatError("is empty", path)
    if _sound(path, size, OLA_RECORD):
        check_whole(path, size, -(-size // OLA_RECORD.itemsize), OLA_RECORD)
        return
    if _sound(path, size, OLA_RECORD.newbyteorder()):
        raise FormatError(
            "is an OLA table in big-endian byte order", path, "convert it to little-endian"
        )
    if _is_old(path, size):
        raise FormatError(
            f"has the {_OLD_SIZE}-byte records of early simulated OLA tables, whose 17 fields "
            "are not documented",
            path,
            "convert it to the 186-byte records of level 2",
        )
    raise FormatError(
        f"is no OLA table: {size} bytes do not hold sound records of {OLA_RECORD.itemsize} bytes",
        path,
        "name the right format",
    )


def _sound(path: Path, size: int, record: np.dtype[Any]) -> bool:
    """Return whether most records, probed over the file, are self-consistent.

    Each states its position twice (x, y, z in metres; radius in kilometres) and an ephemeris
    time; with a wrong byte order or record length these never agree. A flagged return may state
    no position at all, so that only its time and flag are checked. The factor of a thousand
    accepts a table with a wrong unit, which the screening reports.
    """
    count = size // record.itemsize
    if count == 0:
        return False
    probes = probed(path, record, count)
    with np.errstate(all="ignore"):
        timed = np.abs(probes["et"]) < 1e10
        timed &= np.abs(probes["et"]) > 1.0
        ratio = norms(probes["xyz"].astype(np.float64)) / (probes["radius_km"] * 1e3)
        placed = (ratio > 0.5e-3) & (ratio < 2e3)
        flagged = (probes["flag_status"] % 100 != 0) & (np.abs(probes["flag_status"]) < 1000)
    sound: int = int((timed & (placed | flagged)).sum())
    return 2 * sound > len(probes)


def _is_old(path: Path, size: int) -> bool:
    """Return whether time texts are at the same offset in the first two 144-byte records."""
    if size < 2 * _OLD_SIZE or size % _OLD_SIZE:
        return False
    with path.open("rb") as stream:
        first, second = stream.read(_OLD_SIZE), stream.read(_OLD_SIZE)
    found, again = _TIME_TEXT.search(first), _TIME_TEXT.search(second)
    return found is not None and again is not None and found.start() == again.start()


def _table(scan: Scan) -> NDArray[Any]:
    table = np.zeros(len(scan), dtype=OLA_RECORD)
    for name in ("power_cycle", "laser_selection", "scan_mode"):
        table[name] = -1
    for name in ("met_offset", "scan_ola_time", "azimuth_mrad", "elevation_mrad", "intensity_t0"):
        table[name] = np.nan
    radius = norms(scan.points)
    longitude = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        latitude = np.arcsin(np.clip(scan.points[:, 2] / radius, -1, 1))
    table["met"] = b" " * 18
    table["utc"] = _utc_texts(scan.time)
    table["et"] = scan.time
    table["flag_status"] = scan.flag
    table["range_mm"] = scan.range * 1e3
    table["intensity_trr"] = scan.intensity
    table["xyz"] = scan.points
    table["elongitude_deg"] = np.degrees(longitude) % 360
    table["latitude_deg"] = np.degrees(latitude)
    table["radius_km"] = radius * 1e-3
    table["scxyz"] = scan.spacecraft
    return table


def _utc_texts(time: FloatArray) -> AnyArray:
    """UTC to the millisecond, as text (N,); blank where the time is unknown.

    One time is converted by SPICE and the others counted from it: exact unless a leap second
    falls within the chunk. The text is informative; `et` is what is read back.
    """
    texts = np.full(len(time), b" " * 24, dtype="S24")
    known = np.isfinite(time)
    if known.any():
        first = float(time[known].min())
        start = np.datetime64(iso_utc(first), "us").astype(np.int64)
        elapsed = np.round((time[known] - first) * 1e6).astype(np.int64)
        second, part = np.divmod((start + elapsed) // 1000, 1000)
        # The texts of seconds and of thousandths are made once each, and joined as bytes.
        seconds, which = np.unique(second, return_inverse=True)
        clock = np.datetime_as_string(seconds.astype("datetime64[s]")).astype("S19")
        characters = np.empty((len(second), 24), dtype=np.uint8)
        characters[:, :19] = _characters(clock)[which]
        characters[:, 19:23] = _MILLISECONDS[part]
        characters[:, 23] = 0
        texts[known] = characters.view("S24")[:, 0]
    return texts


def _characters(texts: AnyArray) -> AnyArray:
    """Return byte texts (N,) of equal length as numbers (N, length)."""
    return texts.view(np.uint8).reshape(len(texts), -1)


_MILLISECONDS = _characters(np.array([b".%03d" % part for part in range(1000)]))
