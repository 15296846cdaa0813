"""NEAR laser rangefinder CDR: 193-byte text records after two header lines; metres, degrees."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lidar.formats.records.options import LidarOptions
from lidar.formats.records.rows import RowLayout, first_lines, flags_of, mostly, read_rows
from lidar.formats.records.screening import Agreement, Records, Screen, cartesian, spherical_of
from lidar.formats.records.times import times_differ
from lidar.scans import Scan

_NAMES = (
    *("lonE", "latN", "Eros_rad", "ET", "UTC", "Range", "t", "a", "SClon", "SClat", "SCrdst"),
    *("Emission", "Offnadir", "SCLCKCH", "Eros_x", "Eros_y", "Eros_z", "Omega", "U"),
)
_WANTED = (
    *("lonE", "latN", "Eros_rad", "ET", "Range", "a", "SClon", "SClat", "SCrdst"),
    *("Eros_x", "Eros_y", "Eros_z"),
)
_LAYOUT = RowLayout(
    count=len(_NAMES),
    numbers=tuple(_NAMES.index(name) for name in _WANTED),
    texts=(_NAMES.index("UTC"),),
    skip=2,
    fixed=True,
)
# The spacecraft's longitude and latitude have few decimals: errors of a metre or more.
_AGREEMENT = Agreement(offset_m=0.0, tolerance_m=20.0)


def is_nlr(head: bytes) -> bool:
    """Return whether the first bytes of a file are two header lines and NLR records."""
    return mostly(first_lines(head)[_LAYOUT.skip :], _LAYOUT.is_timed_row)


def read_nlr(path: Path, options: LidarOptions) -> Iterator[Scan]:
    """Yield the returns of an NLR table; those marked as noise (a = 1) are refused."""
    screen = Screen(path, _AGREEMENT, options)
    for rows in read_rows(path, _LAYOUT, options.chunk):
        column = dict(zip(_WANTED, rows.numbers, strict=True))
        flag, known = flags_of(column["a"])
        yield screen.scan(
            Records(
                points=np.stack([column[f"Eros_{axis}"] for axis in "xyz"], axis=1),
                spacecraft=cartesian(
                    spherical_of(column["SClon"], column["SClat"], column["SCrdst"])
                ),
                range=column["Range"],
                spherical=spherical_of(column["lonE"], column["latN"], column["Eros_rad"]),
                time=column["ET"],
                flag=flag,
                refused={
                    "noise": flag == 1,
                    "unknown flag": ~known | (flag > 1) | (flag < 0),
                    "UTC and ET disagree": times_differ(column["ET"], rows.texts[0]),
                },
                unreadable=rows.unreadable,
            )
        )
