"""Track text: a point and perhaps its time, spacecraft and intensity on each line, no header."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, first_lines, is_number, mostly, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen
from lidar.formats.records.times import is_time, times_of
from lidar.scans import Scan
from spcola.errors import FormatError

# Quantities by the count of numbers; a UTC may precede them.
_VARIANTS = {
    3: ("x", "y", "z"),
    4: ("x", "y", "z", "intensity"),
    6: ("x", "y", "z", "scx", "scy", "scz"),
    7: ("x", "y", "z", "scx", "scy", "scz", "intensity"),
}
_UNUSED = Agreement(offset_m=0.0, tolerance_m=1.0)


def is_track(head: bytes) -> bool:
    """Return whether the first bytes of a file are track lines that begin with a UTC.

    Lines of numbers alone are not recognised: their quantities and units are unknown.
    """
    lines = first_lines(head)
    separator = _separator(lines)

    def fits(line: str) -> bool:
        fields = line.split(separator)
        return len(fields) - 1 in _VARIANTS and is_time(fields[0].strip())

    return mostly(lines, fits)


def read_track(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the points of a track, whose coordinates are kilometres unless `options` differ.

    Variants: x y z [scx scy scz] [intensity], with or without a UTC before them.

    Raises
    ------
    FormatError
        If the lines have another number of columns, or the last one is cut off.
    """
    layout, names = _layout(path)
    screen = Screen(path, _UNUSED, options)
    unit = options.unit_m("km")
    for rows in read_rows(path, layout, options.chunk):
        column = dict(zip(names, rows.numbers, strict=True))
        flying = "scx" in column
        yield screen.scan(
            Records(
                points=unit * np.stack([column[name] for name in names[:3]], axis=1),
                spacecraft=unit * rows.numbers[3:6].T if flying else None,
                intensity=column.get("intensity"),
                time=times_of(rows.texts[0]) if rows.texts else None,
                unreadable=rows.unreadable,
            )
        )


def _separator(lines: list[str]) -> str | None:
    return "," if sum("," in line for line in lines) * 2 > len(lines) else None


def _layout(path: Path) -> tuple[RowLayout, tuple[str, ...]]:
    """Return the layout of the first line that has one of the variants, and what is in it."""
    with path.open("rb") as stream:
        lines = first_lines(stream.read(8192))
    separator = _separator(lines)
    for line in lines:
        fields = [field.strip() for field in line.split(separator)]
        timed = int(bool(fields) and is_time(fields[0]))
        names = _VARIANTS.get(len(fields) - timed)
        if names is not None and all(map(is_number, fields[timed:])):
            numbers = tuple(range(timed, len(fields)))
            return RowLayout(len(fields), numbers, (0,) * timed, separator), names
    raise FormatError(
        "has no line of 3, 4, 6 or 7 numbers with or without a UTC (2018-07-01T22:50:11) before "
        "them",
        path,
        "name the right format",
    )
