"""Writing of scans as LAS or LAZ, with range and spacecraft in extra dimensions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import date, timedelta
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from lidar.formats.clouds.las import ADJUSTED_EPOCH_ET_S, FLAG, RANGE, SPACECRAFT
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.atomic import replacing
from spcola.errors import InvalidValueError

# Coordinates are whole numbers of this many metres, or of a power of ten times as many where
# 32 bits would not suffice.
_FINEST_M = 1e-4
_MOST_COUNTS = 2**31 - 2
_UNCLASSIFIED = 1
_MOST_INTENSITY = 65535
# Ephemeris time counts from the noon of this day.
_J2000, _NOON_S = date(2000, 1, 1), 43_200.0


def write_las(path: str | Path, chunks: Iterable[Scan], *, compressed: bool = True) -> None:
    """Write the chunks of a scan as LAS 1.4 (LAZ if compressed), whole or not at all.

    Points, range and spacecraft are rounded to 0.1 mm (coarser beyond 100 km), strengths to whole
    numbers of 16 bits. Times are written as adjusted standard GPS time, the flag as an extra
    dimension; the class is 1 (unclassified). Range and spacecraft, extra dimensions too, are left
    out if some are unknown in the first chunk; so are times.

    Parameters
    ----------
    path : path
    chunks : iterable of Scan
        Only one is in memory at a time.
    compressed : bool

    Raises
    ------
    InvalidValueError
        If there is no return, or a later chunk lacks layers or range of the first one.
    WorkspaceError
        If the file cannot be written.
    """
    # laspy is slow to import, and most runs write no LAS.
    import laspy  # noqa: PLC0415

    filled = (scan for scan in chunks if len(scan))
    first = next(filled, None)
    if first is None:
        raise InvalidValueError("has no return to write", path)
    layout = _Layout(first, path)
    with replacing(path) as temporary, temporary.open("wb") as stream:
        header = layout.header(laspy)
        with laspy.open(
            stream, mode="w", header=header, do_compress=compressed, closefd=False
        ) as writer:
            for record in _records(chain([first], filled), layout, header, laspy):
                writer.write_points(record)


class _Layout:
    """Layout fixed by the first chunk of a scan: which layers are known, and their extent."""

    def __init__(self, first: Scan, path: str | Path) -> None:
        self.path = path
        self.timed = bool(np.isfinite(first.time).all())
        self.altimeter = bool(
            np.isfinite(first.range).all() and np.isfinite(first.spacecraft).all()
        )
        largest = float(np.abs(first.points).max())
        if self.altimeter:
            largest = max(largest, float(np.abs(first.spacecraft).max()))
            largest = max(largest, float(np.abs(first.range).max()))
        # The header has the day of the scan: today's would make equal scans differ.
        self.day = _J2000
        if self.timed:
            self.day += timedelta(days=(float(first.time[0]) + _NOON_S) // 86400.0)
        # Later returns may lie further out than the first ones: four times at most.
        self.scale = _FINEST_M
        while 4.0 * largest > self.scale * _MOST_COUNTS:
            self.scale *= 10.0

    def header(self, laspy: Any) -> Any:
        """Return an empty LAS 1.4 header of point format 6."""
        header = laspy.LasHeader(version="1.4", point_format=6)
        header.generating_software = "SPCOLA"
        header.creation_date = self.day
        header.scales, header.offsets = np.full(3, self.scale), np.zeros(3)
        # LAS 1.4 requires systems for point format 6 as text; body-fixed frames have none.
        header.global_encoding.wkt = True
        if self.timed:
            header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
        header.add_extra_dim(laspy.ExtraBytesParams(FLAG, "i2"))
        for name in (RANGE, *SPACECRAFT) if self.altimeter else ():
            scales, offsets = np.array([self.scale]), np.zeros(1)
            header.add_extra_dim(
                laspy.ExtraBytesParams(name, "i4", "metres", scales=scales, offsets=offsets)
            )
        # laspy would state the first value of each chunk as least and greatest: state none.
        for extra in header.vlrs.get("ExtraBytesVlr")[0].extra_bytes_structs:
            extra.options &= ~(extra.MIN_BIT_MASK | extra.MAX_BIT_MASK)
        return header

    def checked(self, values: FloatArray, what: str) -> FloatArray:
        """Return lengths unchanged, metres; refuse those that the file cannot represent."""
        # Comparisons with NaN are false.
        if not np.all(np.abs(values) <= self.scale * _MOST_COUNTS):
            raise InvalidValueError(
                f"{what} of a later chunk is unknown or far beyond those of the first",
                self.path,
                "write a scan whose layers are known throughout",
            )
        return values


def _records(scans: Iterable[Scan], layout: _Layout, header: Any, laspy: Any) -> Iterator[Any]:
    """Yield the returns of each chunk as LAS point records."""
    for scan in scans:
        record = laspy.ScaleAwarePointRecord.zeros(len(scan), header=header)
        points = layout.checked(scan.points, "position")
        record.x, record.y, record.z = points[:, 0], points[:, 1], points[:, 2]
        strength = np.clip(np.nan_to_num(np.round(scan.intensity)), 0, _MOST_INTENSITY)
        record.intensity = strength.astype(np.uint16)
        record.classification = np.full(len(scan), _UNCLASSIFIED, dtype=np.uint8)
        record.return_number = record.number_of_returns = np.ones(len(scan), dtype=np.uint8)
        record[FLAG] = scan.flag.astype(np.int16)
        if layout.timed:
            if not np.isfinite(scan.time).all():
                raise InvalidValueError("time of a later chunk is unknown", layout.path)
            record.gps_time = scan.time - ADJUSTED_EPOCH_ET_S
        if layout.altimeter:
            record[RANGE] = layout.checked(scan.range, "range")
            for axis, name in enumerate(SPACECRAFT):
                record[name] = layout.checked(scan.spacecraft[:, axis], "spacecraft")
        yield record
