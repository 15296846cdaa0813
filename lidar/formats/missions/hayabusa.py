"""Hayabusa lidar CDR: 291-byte text records of 31 columns, kilometres."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, first_lines, mostly, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen
from lidar.formats.records.times import times_of
from lidar.scans import Scan

_KM = 1e3
# Positions come from another reduction than the range; no offset between them is published.
_AGREEMENT = Agreement(offset_m=0.0, tolerance_m=20.0)


def _split(line: str) -> list[str]:
    """Split a record: MET in columns 1–10, UTC in 12–34, 29 numbers after that."""
    return [line[:10], line[11:34], *line[35:].replace(",", " ").split()]


_LAYOUT = RowLayout(count=31, numbers=tuple(range(2, 9)), texts=(1,), fixed=True, split=_split)


def is_hayabusa(head: bytes) -> bool:
    """Return whether the first bytes of a file are Hayabusa CDR records."""

    def fits(line: str) -> bool:
        return _LAYOUT.is_timed_row(line) and _LAYOUT.fields(line)[0].isdigit()

    return mostly(first_lines(head), fits)


def read_hayabusa(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the returns of a Hayabusa CDR table: range, spacecraft and surface point, from km."""
    screen = Screen(path, _AGREEMENT, options)
    for rows in read_rows(path, _LAYOUT, options.chunk):
        yield screen.scan(
            Records(
                points=_KM * rows.numbers[4:7].T,
                spacecraft=_KM * rows.numbers[1:4].T,
                range=_KM * rows.numbers[0],
                time=times_of(rows.texts[0]),
                unreadable=rows.unreadable,
            )
        )
