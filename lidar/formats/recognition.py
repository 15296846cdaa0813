"""Recognition of the format of a lidar file from its content, never from its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from lidar.formats.clouds.cloud import is_cloud, read_cloud
from lidar.formats.clouds.las import is_las, read_las
from lidar.formats.missions.hayabusa import is_hayabusa, read_hayabusa
from lidar.formats.missions.hayabusa2 import is_hayabusa2, read_hayabusa2
from lidar.formats.missions.lola import is_lola, read_lola
from lidar.formats.missions.nlr import is_nlr, read_nlr
from lidar.formats.missions.ola import is_ola, read_ola
from lidar.formats.missions.track import is_track, read_track
from lidar.formats.native.scan_file import is_native, read_native
from lidar.formats.records.options import LidarOptions
from lidar.formats.tables.table import is_table, read_table
from lidar.scans import Scan
from spcola.errors import FormatError
from spcola.formats.text import regular_size

_HEAD_BYTES = 8192


@dataclass(frozen=True)
class LidarFormat:
    """One format: its recognition and its reader.

    Parameters
    ----------
    matches : callable (path, head, size) -> bool
        Whether a file of `size` bytes that begins with `head` has the format.
    read : callable (path, options) -> iterator of Scan
        Raises FormatError if the file is not of the format, is cut off, or contradicts itself.
    """

    matches: Callable[[Path, bytes, int], bool]
    read: Callable[[Path, LidarOptions], Iterator[Scan]]


# Formats with a signature come first, then binary tables, text with a header, and text without:
# the rows of a table with a header may look like a track's.
FORMATS: Mapping[str, LidarFormat] = MappingProxyType(
    {
        "native": LidarFormat(lambda _path, head, _size: is_native(head), read_native),
        "las": LidarFormat(lambda _path, head, _size: is_las(head), read_las),
        "cloud": LidarFormat(lambda _path, head, _size: is_cloud(head), read_cloud),
        "ola": LidarFormat(lambda path, _head, size: is_ola(path, size), read_ola),
        "table": LidarFormat(lambda _path, head, _size: is_table(head), read_table),
        "lola": LidarFormat(is_lola, read_lola),
        "hayabusa": LidarFormat(lambda _path, head, _size: is_hayabusa(head), read_hayabusa),
        "hayabusa2": LidarFormat(lambda _path, head, _size: is_hayabusa2(head), read_hayabusa2),
        "nlr": LidarFormat(lambda _path, head, _size: is_nlr(head), read_nlr),
        "track": LidarFormat(lambda _path, head, _size: is_track(head), read_track),
    }
)
"""Formats by name, in the order in which they are tried."""


def recognise(path: str | Path) -> str:
    """Return the name of the format of the lidar file at `path`, from its content.

    Raises
    ------
    FormatError
        If the file cannot be read, is empty, or has no known format.
    """
    source = Path(path)
    head, size = _head(source)
    if size == 0:
        raise FormatError("is empty", source)
    for name, candidate in FORMATS.items():
        if candidate.matches(source, head, size):
            return name
    raise FormatError(
        "has no known lidar format",
        source,
        f"name its format if it is one of {', '.join(FORMATS)}",
    )


def _head(path: Path) -> tuple[bytes, int]:
    """Return the first bytes of a file and its size."""
    try:
        size = regular_size(path)
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
        return head, size
    except OSError as error:
        reason = error.strerror or str(error)
        raise FormatError(f"cannot be read ({reason})", path) from error
