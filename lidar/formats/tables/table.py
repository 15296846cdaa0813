"""Tables of returns: text with a header line that names the columns and their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowChunk, RowLayout, first_lines, flags_of, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen, cartesian
from lidar.formats.records.times import times_of
from lidar.formats.tables.columns import Column, chosen_columns, named_columns, quantity_of
from lidar.scans import Scan
from spcola.arrays import FloatArray
from spcola.errors import FormatError

_POINT = ("x", "y", "z")
_PLACE = ("lon", "lat", "radius")
# The instrument is unknown, hence the reference point of its range too.
_AGREEMENT = Agreement(offset_m=0.0, tolerance_m=10.0)


def is_table(head: bytes) -> bool:
    """Return whether a file begins with a header that names coordinates (with units or without)."""
    lines = first_lines(head)
    if len(lines) < 2:
        return False
    headers, separator = _headers(lines[0])
    found = {named[0] for named in map(quantity_of, headers) if named is not None}
    row = next((line for line in lines[1:] if line.strip()), "")
    same = len(row.split(separator)) == len(headers)
    return same and (found >= set(_POINT) or found >= set(_PLACE))


def read_table(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the returns of a table with named columns.

    The header names columns and units, as ``x_m``, ``lon_deg``, ``scx_km``, ``range [m]``,
    ``time_et_s``, ``utc``, ``intensity``, ``flag``, ``sigma_m``; or ``options.columns`` does, and
    then no other column is read. Needed are x, y, z, or lon, lat, radius; with both, they are
    compared. Longitudes are east.

    Raises
    ------
    FormatError
        If a needed column or a unit is missing, the table is cut off, or contradicts itself.
    """
    headers, separator = _header_of(path)
    place = f"{path}, line 1"
    if options.columns:
        columns = chosen_columns(headers, options.columns, place)
    else:
        columns = named_columns(headers, place)
    _check_complete(columns, headers, place)
    texts = ("time",) if "time" in columns and columns["time"].unit == "utc" else ()
    names = [name for name in columns if name not in texts]
    layout = RowLayout(
        count=len(headers),
        numbers=tuple(columns[name].index for name in names),
        texts=tuple(columns[name].index for name in texts),
        separator=separator,
        skip=1,
    )
    screen = Screen(path, _AGREEMENT, options)
    for rows in read_rows(path, layout, options.chunk):
        yield screen.scan(_records(rows, names, columns))


def _headers(line: str) -> tuple[list[str], str | None]:
    """Return the column names in a header line (a # may stand before them), and the separator."""
    line = line.lstrip("\ufeff# ").rstrip()
    separator = next((mark for mark in (",", ";", "\t") if mark in line), None)
    return line.split(separator), separator


def _header_of(path: Path) -> tuple[list[str], str | None]:
    with path.open(encoding="utf-8", errors="replace") as stream:
        line = stream.readline()
    if not line.strip():
        raise FormatError("has no header line", f"{path}, line 1", "name its columns there")
    return _headers(line)


def _check_complete(columns: Mapping[str, Column], headers: list[str], place: str) -> None:
    """Refuse a table without positions, or with part of a vector."""
    if not all(name in columns for name in _POINT) and not all(name in columns for name in _PLACE):
        raise FormatError(
            f"names no x, y, z and no lon, lat, radius among {', '.join(headers)}",
            place,
            "name the columns with their units, as x_m, or state columns {'x': 'X [km]', …}",
        )
    for group in (_POINT, _PLACE, ("scx", "scy", "scz"), ("sclon", "sclat", "scradius")):
        given = [name for name in group if name in columns]
        if given and len(given) < len(group):
            lacking = ", ".join(name for name in group if name not in columns)
            raise FormatError(f"has column {given[0]} but no {lacking}", place)


def _records(rows: RowChunk, names: list[str], columns: Mapping[str, Column]) -> Records:
    si = {name: columns[name].si(values) for name, values in zip(names, rows.numbers, strict=True)}
    spherical = _triple(si, _PLACE)
    points = _triple(si, _POINT)
    if points is None and spherical is not None:
        points, spherical = cartesian(spherical), None
    spacecraft = _triple(si, ("scx", "scy", "scz"))
    above = _triple(si, ("sclon", "sclat", "scradius"))
    if spacecraft is None and above is not None:
        spacecraft = cartesian(above)
    flag, known = flags_of(si["flag"]) if "flag" in si else (None, None)
    return Records(
        points=np.empty((0, 3)) if points is None else points,
        spacecraft=spacecraft,
        range=si.get("range"),
        spherical=spherical,
        time=times_of(rows.texts[0]) if rows.texts else si.get("time"),
        intensity=si.get("intensity"),
        flag=flag,
        sigma=si.get("sigma"),
        refused={} if known is None else {"unknown flag": ~known},
        unreadable=rows.unreadable,
    )


def _triple(si: Mapping[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    """Return three columns as one array (N, 3), None if the table does not have them."""
    if not all(name in si for name in names):
        return None
    return np.stack([si[name] for name in names], axis=1)
