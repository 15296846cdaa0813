"""LAS, LAZ and COPC: airborne and ground lidar as body-fixed returns, in metres."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from lidar.formats.clouds.las_crs import LasSystem, las_system
from lidar.formats.clouds.laz import check_chunk_table, try_decompressor
from lidar.formats.records.options import LidarOptions
from lidar.formats.records.screening import Agreement, Records, Screen
from lidar.scans import Scan
from spcola.arrays import BoolArray, FloatArray
from spcola.errors import FormatError, SpcolaError
from spcola.formats.text import regular_size

MAGIC = b"LASF"

# Low and high noise of the ASPRS standard classes.
_NOISE_CLASSES = (7, 18)
# 1980-01-06T00:00:00 of GPS time is 51.184 s TDB past that clock reading, 7300.5 days before J2000.
_GPS_EPOCH_ET_S = -7300.5 * 86400.0 + 51.184
ADJUSTED_EPOCH_ET_S = _GPS_EPOCH_ET_S + 1e9
"""Ephemeris time at which adjusted standard GPS time is 0, s."""
RANGE, FLAG = "range", "flag"
SPACECRAFT = ("spacecraft_x", "spacecraft_y", "spacecraft_z")
"""Extra dimensions that mark a file of an altimeter, in its unit of length."""

_AGAIN = "fetch the file again"
# The range may have another reference point than the spacecraft position, as OLA's has.
_AGREEMENT = Agreement(offset_m=0.0, tolerance_m=2.0)


def is_las(head: bytes) -> bool:
    """Return whether a file begins as LAS, LAZ and COPC do."""
    return head.startswith(MAGIC)


def read_las(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the returns of a LAS, LAZ or COPC file; the flag of a return is its class.

    Coordinates are metres unless the file states a coordinate reference system: lengths in another
    unit are converted, longitude and latitude refused. Map coordinates x, y and z are used
    unchanged, as on a plane.

    Withheld returns and the noise classes 7 and 18 are refused, and those outside the box in the
    header. The spacecraft and the range are unknown, except for a file with the extra dimensions
    of an altimeter (``range``, ``spacecraft_x`` and so on, as written by
    :func:`lidar.formats.clouds.write_las`): these give range and spacecraft, and the GPS time if it
    is adjusted standard time, and ``flag`` replaces the class.

    Raises
    ------
    FormatError
        If the file is cut off, its header is not sound, or its coordinates are no lengths.
    """
    screen = Screen(path, _AGREEMENT, options)
    with _opened(path) as reader:
        header = reader.header
        with _decoding(path, "its header"):
            _check_header(path, header, options)
            units = np.array(_system(path, reader).units_m(path, options.unit))
        if header.are_points_compressed:
            try_decompressor(path, header)
        chunks, count = reader.chunk_iterator(options.chunk), 0
        while True:
            with _decoding(path, f"after return {count}"):
                chunk = next(chunks, None)
                if chunk is None:
                    break
                records = _records(path, chunk, header, options, units)
            count += len(chunk)
            yield screen.scan(records)
    if count != header.point_count:
        raise FormatError(
            f"is truncated: {count} of {header.point_count} returns are there", path, _AGAIN
        )


def read_las_system(path: Path) -> LasSystem:
    """Return the coordinate reference system that the LAS, LAZ or COPC file at `path` states.

    Raises
    ------
    FormatError
        If it is no such file, or the system cannot be read.
    """
    with _opened(path) as reader:
        return _system(path, reader)


def _system(path: Path, reader: Any) -> LasSystem:
    """Return the coordinate reference system of an open file."""
    return las_system(path, reader.header, [*reader.header.vlrs, *(reader.evlrs or [])])


def _opened(path: Path) -> Any:
    _check_records(path)
    # laspy is slow to import, and most runs read no LAS.
    import laspy  # noqa: PLC0415

    # Its log messages repeat the error.
    logging.getLogger("laspy").addHandler(logging.NullHandler())

    with _decoding(path, "its header"):
        reader = laspy.open(path)
        try:
            if reader.header.are_points_compressed:
                check_chunk_table(path, reader.header)
        except BaseException:
            reader.close()
            raise
        return reader


@contextmanager
def _decoding(path: Path, where: str) -> Iterator[None]:
    """Turn errors of laspy's struct, numpy and Rust parts into one line.

    A panic of the Rust part is no `Exception`.
    """
    try:
        yield
    except (SpcolaError, MemoryError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        raise FormatError(
            f"is no whole LAS file ({error or type(error).__name__})", f"{path}, {where}", _AGAIN
        ) from error


def _check_records(path: Path) -> None:
    """Refuse a header that states more variable-length records than fit into the file.

    Four thousand million of them would keep the reader busy for hours.
    """
    with path.open("rb") as stream:
        header = stream.read(247)
        size = regular_size(path)
        if len(header) < 104 or not is_las(header):
            raise FormatError("is no whole LAS file", path, _AGAIN)
        begin, points, count = struct.unpack_from("<HII", header, 94)
        fits = points <= size and _have_room(stream, begin, count, "<20xH32x", points)
        if header[25] >= 4 and len(header) >= 247:
            begin, count = struct.unpack_from("<QI", header, 235)
            fits &= _have_room(stream, begin, count, "<20xQ32x", size)
    if not fits:
        raise FormatError(
            "promises more records before or behind its points than have room",
            f"{path}, header",
            _AGAIN,
        )


def _have_room(stream: BinaryIO, begin: int, count: int, form: str, end: int) -> bool:
    """Return whether records, whose heads state their lengths, end before byte `end`."""
    for _ in range(count):
        if begin + struct.calcsize(form) > end:
            return False
        stream.seek(begin)
        begin += struct.calcsize(form) + struct.unpack(form, stream.read(struct.calcsize(form)))[0]
    return begin <= end or count == 0


def _check_header(path: Path, header: Any, options: LidarOptions) -> None:
    """Refuse a header without usable coordinates, and plain files that are cut off."""
    scales, offsets = np.asarray(header.scales), np.asarray(header.offsets)
    if not (np.all(scales > 0) and np.all(np.isfinite(scales)) and np.all(np.isfinite(offsets))):
        raise FormatError(f"has scales {scales} and offsets {offsets}", f"{path}, header")
    if header.point_count == 0:
        raise FormatError("holds no returns", path)
    if not header.are_points_compressed:
        size = header.point_format.size
        there = (path.stat().st_size - header.offset_to_point_data) // size
        if there < header.point_count:
            raise FormatError(
                f"is truncated: {max(there, 0)} of {header.point_count} returns are there",
                path,
                _AGAIN,
            )
    if options.gps_time:
        _check_time(path, header)


def _check_time(path: Path, header: Any) -> None:
    if "gps_time" not in header.point_format.dimension_names:
        raise FormatError("has no GPS time", path, "import it without gps_time")
    if not _is_adjusted(header):
        raise FormatError(
            "gives seconds of a GPS week that it does not name",
            path,
            "import it without gps_time, or convert it to adjusted standard GPS time",
        )


def _is_adjusted(header: Any) -> bool:
    """Return whether times are adjusted standard GPS time."""
    return bool(header.global_encoding.gps_time_type.value == 1)


def _records(
    path: Path, chunk: Any, header: Any, options: LidarOptions, units_m: FloatArray
) -> Records:
    stated = np.stack([np.asarray(chunk[axis]) for axis in "xyz"], axis=1).astype(np.float64)
    classes = np.asarray(chunk["classification"]).astype(np.int16)
    names = set(header.point_format.dimension_names)
    altimeter = {RANGE, *SPACECRAFT} <= names
    time = measured = spacecraft = None
    if altimeter:
        measured = np.asarray(chunk[RANGE], dtype=np.float64) * units_m[0]
        spacecraft = np.stack([np.asarray(chunk[axis]) for axis in SPACECRAFT], axis=1)
        spacecraft = spacecraft.astype(np.float64) * units_m
    if options.gps_time or (altimeter and _is_adjusted(header)):
        time = np.asarray(chunk["gps_time"]) + ADJUSTED_EPOCH_ET_S
    return Records(
        points=stated * units_m,
        spacecraft=spacecraft,
        range=measured,
        intensity=np.asarray(chunk["intensity"]).astype(np.float64),
        time=time,
        flag=np.asarray(chunk[FLAG]).astype(np.int16) if altimeter and FLAG in names else classes,
        refused={
            "withheld": np.asarray(chunk["withheld"]).astype(bool),
            "noise class": np.isin(classes, _NOISE_CLASSES),
            "outside the header's bounds": _outside(path, stated, header),
        },
    )


def _outside(path: Path, stated: FloatArray, header: Any) -> BoolArray:
    """Return which coordinates lie outside the header's box; refuse the box if most do."""
    slack = np.asarray(header.scales)
    lowest, highest = np.asarray(header.mins) - slack, np.asarray(header.maxs) + slack
    outside: BoolArray = ~((stated >= lowest) & (stated <= highest)).all(axis=1)
    if 2 * outside.sum() > len(outside):
        raise FormatError(
            f"{outside.sum()} of {len(outside)} returns lie outside the box of its header",
            f"{path}, header",
            "correct its bounds, scales or offsets",
        )
    return outside
