"""Hayabusa2 lidar L2 ``topo_ts``: comma-separated rows of 11 fields without a header."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, first_lines, mostly, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen, spherical_of
from lidar.formats.records.times import times_of
from lidar.scans import Scan

_LAYOUT = RowLayout(count=11, numbers=tuple(range(1, 11)), texts=(0,), separator=",")
# Range is given to a decimetre, longitude and latitude to 0.001°.
_AGREEMENT = Agreement(offset_m=0.0, tolerance_m=5.0)


def is_hayabusa2(head: bytes) -> bool:
    """Return whether the first bytes of a file are rows of a Hayabusa2 L2 table."""
    return mostly(first_lines(head), _LAYOUT.is_timed_row)


def read_hayabusa2(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the shots of a Hayabusa2 L2 table (metres, degrees, Ryugu body-fixed).

    Each row states the position twice: longitude, latitude, radius, and x, y, z.
    """
    screen = Screen(path, _AGREEMENT, options)
    for rows in read_rows(path, _LAYOUT, options.chunk):
        measured, longitude, latitude, radius = rows.numbers[:4]
        yield screen.scan(
            Records(
                points=rows.numbers[4:7].T.copy(),
                spacecraft=rows.numbers[7:10].T.copy(),
                range=measured,
                spherical=spherical_of(longitude, latitude, radius),
                time=times_of(rows.texts[0]),
                unreadable=rows.unreadable,
            )
        )
