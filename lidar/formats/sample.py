"""Some returns of a lidar file, evenly chosen: for pictures and for clouds that fit into memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lidar.formats.reader import open_lidar
from lidar.formats.records import LidarOptions
from lidar.scans import Scan, join
from spcola.errors import FormatError


@dataclass(frozen=True, eq=False)
class ScanSample:
    """Some returns of a file, evenly chosen.

    Parameters
    ----------
    scan : Scan
    count : int
        Returns of the whole file.
    rejected : mapping of str to int
        Records of it that are no returns, by reason.
    """

    scan: Scan
    count: int
    rejected: Mapping[str, int]


def read_sample(
    path: str | Path, most: int, *, format: str | None = None, options: LidarOptions | None = None
) -> ScanSample:
    """Read a lidar file and keep every k-th return, so that they are at most `most`.

    Parameters
    ----------
    path : str or Path
    most : int
        All returns are kept if they are no more than these.
    format : str, optional
        Recognised from the content if not given.
    options : LidarOptions, optional

    Raises
    ------
    FormatError
        If the file cannot be read, or holds no return.
    """
    kept: list[Scan] = []
    step, count = 1, 0
    rejected: Counter[str] = Counter()
    for chunk in open_lidar(path, format=format, options=options or LidarOptions()):
        rejected.update(chunk.rejected)
        kept.append(chunk.select(np.arange(-count % step, len(chunk), step)))
        count += len(chunk)
        while sum(map(len, kept)) > most:
            step *= 2
            whole = join(chunk.name, kept)
            kept = [whole.select(np.arange(0, len(whole), 2))]
    if not count:
        raise FormatError("holds no return", path)
    return ScanSample(join(kept[0].name, kept), count, dict(rejected))
