"""Reading a lidar file of any known format as scans."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lidar.formats.options import LidarOptions
from lidar.formats.recognition import FORMATS, recognise
from lidar.scans import Scan, join
from spcola.errors import FormatError

_DEFAULTS = LidarOptions()


def open_lidar(
    path: str | Path, *, format: str | None = None, options: LidarOptions = _DEFAULTS
) -> Iterator[Scan]:
    """Return the chunks of a lidar file, in order, at most ``options.chunk`` records each.

    Parameters
    ----------
    format : str, optional
        One of `FORMATS`; told from the content if not given.
    options : LidarOptions

    Raises
    ------
    FormatError
        If the format is unknown, or the file does not hold what its format promises. What is
        wrong further on in the file is raised by the chunk in which it lies.
    """
    source = Path(path)
    if format is not None and format not in FORMATS:
        raise FormatError(
            f"{format!r} is no lidar format", source, f"use one of {', '.join(FORMATS)}"
        )
    # Also where the format is named: only a regular file bounds the work on it.
    chosen = format if format is not None and source.is_file() else recognise(source)
    return _checked(source, FORMATS[chosen].read(source, options))


def read_scan(
    path: str | Path, *, format: str | None = None, options: LidarOptions = _DEFAULTS
) -> Scan:
    """Read a whole lidar file as one scan; for files that fit into memory.

    Raises
    ------
    FormatError
        As `open_lidar`.
    """
    chunks = list(open_lidar(path, format=format, options=options))
    return join(chunks[0].name, chunks)


def _checked(path: Path, chunks: Iterator[Scan]) -> Iterator[Scan]:
    """Pass chunks on; what the operating system says becomes one line that names the file."""
    while True:
        try:
            # Garbled numbers overflow on their way to being refused; that is no news to the user.
            with np.errstate(all="ignore"):
                chunk = next(chunks, None)
        except OSError as error:
            raise FormatError(f"cannot be read ({error.strerror or error})", path) from error
        if chunk is None:
            return
        yield chunk
