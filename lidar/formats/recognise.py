"""Recognition: what format a lidar file has, told from its content and never from its name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from lidar.formats.cloud import is_cloud, read_cloud
from lidar.formats.hayabusa import is_hayabusa, read_hayabusa
from lidar.formats.hayabusa2 import is_hayabusa2, read_hayabusa2
from lidar.formats.las import is_las, read_las
from lidar.formats.lola import is_lola, read_lola
from lidar.formats.native import is_native, read_native
from lidar.formats.nlr import is_nlr, read_nlr
from lidar.formats.ola import is_ola, read_ola
from lidar.formats.options import LidarOptions
from lidar.formats.table import is_table, read_table
from lidar.formats.track import is_track, read_track
from lidar.scan import Scan
from spcola.errors import FormatError

_HEAD_BYTES = 8192


@dataclass(frozen=True)
class LidarFormat:
    """One format: how it is recognised, and who reads it.

    Parameters
    ----------
    matches : callable (path, head, size) -> bool
        Whether a file of `size` bytes that begins with `head` has the format.
    read : callable (path, options) -> iterator of Scan
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
    """Return the name of the format of a lidar file, told from its content.

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
        if path.exists() and not path.is_file():
            raise FormatError(
                "is no regular file, and is read more than once",
                path,
                "save what comes out of a pipe or a device to a file",
            )
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
        return head, path.stat().st_size
    except OSError as error:
        reason = error.strerror or str(error)
        raise FormatError(f"cannot be read ({reason})", path) from error
