"""LOLA RDR: comma-separated rows of 29 columns, or binary rows of 256 bytes with five spots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidar.formats.records.binary import check_whole, mapped_chunks, probed
from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, first_lines, flags_of, mostly, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen, cartesian, spherical_of
from lidar.formats.records.times import dynamical_times, times_differ
from lidar.scans import Scan
from spcola.errors import FormatError

_KM = 1e3
# 1-based columns of the rows: lon, lat, radius, range, flag, ET; spacecraft lon, lat, radius.
_COLUMNS = (2, 3, 4, 5, 11, 16, 19, 20, 21)
_LAYOUT = RowLayout(
    count=29, numbers=tuple(c - 1 for c in _COLUMNS), texts=(0,), separator=",", fixed=True
)
# 105 public shots have 0.545 m ± 0.7 mm; other months may differ by their own calibration.
_AGREEMENT = Agreement(offset_m=0.545, tolerance_m=2.0)

_SPOT = np.dtype(
    [
        ("lon_1e7_deg", "<i4"),
        ("lat_1e7_deg", "<i4"),
        ("radius_mm", "<i4"),
        ("range_mm", "<u4"),
        ("rest", "<u4", (5,)),
        ("flag", "<u4"),
    ]
)
_ROW = np.dtype(
    [
        ("met", "<u4", (2,)),
        ("et_s", "<u4"),
        ("et_fraction", "<u4"),
        ("laser", "<i4", (2,)),
        ("sclon_1e7_deg", "<i4"),
        ("sclat_1e7_deg", "<i4"),
        ("scradius_mm", "<u4"),
        ("geoid_mm", "<u4"),
        ("spots", _SPOT, (5,)),
        ("angles", "<u2", (4,)),
        ("earth", "<u4", (2,)),
    ]
)
_MISSING_RANGE = 0xFFFFFFFF


def is_lola(path: Path, head: bytes, size: int) -> bool:
    """Return whether a file has LOLA RDR rows, as text or binary."""
    lines = first_lines(head)
    rows = lines[int(_has_header(lines)) :]
    return mostly(rows, _LAYOUT.is_timed_row) or _is_binary(path, size)


def read_lola(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the shots of a LOLA RDR file; a shot flag that is not zero is refused and counted."""
    with path.open("rb") as stream:
        head = stream.read(8192)
    if not head:
        raise FormatError("is empty", path)
    lines = first_lines(head)
    if lines and not _is_binary(path, path.stat().st_size):
        yield from _read_text(path, options, skip=int(_has_header(lines)))
    else:
        yield from _read_binary(path, options)


def _has_header(lines: list[str]) -> bool:
    """Return whether the first line names columns: it has no digit before its first comma."""
    return bool(lines) and not any(c.isdigit() for c in lines[0].split(",")[0])


def _read_text(path: Path, options: LidarOptions, *, skip: int) -> Iterator[Scan]:
    screen = Screen(path, _AGREEMENT, options)
    layout = RowLayout(_LAYOUT.count, _LAYOUT.numbers, _LAYOUT.texts, ",", skip, fixed=True)
    for rows in read_rows(path, layout, options.chunk):
        lon, lat, radius, measured, flags, time, sclon, sclat, scradius = rows.numbers
        flag, known = flags_of(flags)
        yield screen.scan(
            Records(
                points=cartesian(spherical_of(lon, lat, _KM * radius)),
                spacecraft=cartesian(spherical_of(sclon, sclat, _KM * scradius)),
                range=_KM * measured,
                time=dynamical_times(time, rows.texts[0]),
                flag=flag,
                refused={
                    "missing": (radius < 0) | (measured < 0),
                    "shot flag": known & (flag != 0),
                    "unknown flag": ~known,
                    "UTC and ET disagree": times_differ(time, rows.texts[0]),
                },
                unreadable=rows.unreadable,
            )
        )


def _read_binary(path: Path, options: LidarOptions) -> Iterator[Scan]:
    size = path.stat().st_size
    count = -(-size // _ROW.itemsize)
    check_whole(path, size, count, _ROW)
    screen = Screen(path, _AGREEMENT, options)
    for table in mapped_chunks(path, _ROW, count, max(options.chunk // 5, 1)):
        yield screen.scan(_binary_records(table))


def _binary_records(table: NDArray[Any]) -> Records:
    """Spots of binary rows, shot by shot, in metres and seconds."""
    spots = table["spots"].ravel()
    shots = np.repeat(table, 5)
    flag = spots["flag"].astype(np.int64)
    missing = (spots["radius_mm"] == -1) | (spots["range_mm"] == _MISSING_RANGE)
    sclon, sclat = shots["sclon_1e7_deg"] * 1e-7, shots["sclat_1e7_deg"] * 1e-7
    return Records(
        points=cartesian(
            spherical_of(
                spots["lon_1e7_deg"] * 1e-7,
                spots["lat_1e7_deg"] * 1e-7,
                spots["radius_mm"] * 1e-3,
            )
        ),
        spacecraft=cartesian(spherical_of(sclon, sclat, shots["scradius_mm"] * 1e-3)),
        range=spots["range_mm"] * 1e-3,
        time=shots["et_s"] + shots["et_fraction"] * 2.0**-32,
        flag=flag,
        refused={"missing": missing, "shot flag": flag != 0},
    )


def _is_binary(path: Path, size: int) -> bool:
    """Return whether most probed rows have spacecraft and spots at the Moon's distances."""
    count = size // _ROW.itemsize
    if count == 0:
        return False
    probes = probed(path, _ROW, count)
    spots = probes["spots"]["radius_mm"]
    on_moon = (spots == -1) | ((spots > 1.72e9) & (spots < 1.75e9))
    above = (probes["scradius_mm"] > 1.72e9) & (probes["geoid_mm"] > 1.72e9)
    above &= (np.abs(probes["sclat_1e7_deg"]) <= 9e8) & (probes["geoid_mm"] < 1.75e9)
    sound: int = int((on_moon.all(axis=1) & above).sum())
    return 2 * sound > len(probes)
