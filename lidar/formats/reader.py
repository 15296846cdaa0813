"""Reading a lidar file of any known format as scans."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lidar.formats.recognition import FORMATS, recognise
from lidar.formats.records.options import LidarOptions
from lidar.scans import Scan, join
from spcola.errors import FormatError

_DEFAULTS = LidarOptions()


def open_lidar(
    path: str | Path, *, format: str | None = None, options: LidarOptions = _DEFAULTS
) -> Iterator[Scan]:
    """Return the chunks of a lidar file, in order, at most ``options.chunk`` records each.

    Parameters
    ----------
    path : str or Path
    format : str, optional
        One of `FORMATS`; recognised from the content if not given.
    options : LidarOptions

    Raises
    ------
    FormatError
        If the format is unknown, or the file does not follow it. Errors further on in the file
        are raised by the chunk in which they lie.
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

    `path`, `format`, `options` and errors are those of :func:`open_lidar`.
    """
    chunks = list(open_lidar(path, format=format, options=options))
    return join(chunks[0].name, chunks)


def _checked(path: Path, chunks: Iterator[Scan]) -> Iterator[Scan]:
    """Yield chunks; errors of the operating system become one line that names the file."""
    while True:
        try:
            # Garbled numbers overflow before they are refused: no warning is needed.
            with np.errstate(all="ignore"):
                chunk = next(chunks, None)
        except OSError as error:
            raise FormatError(f"cannot be read ({error.strerror or error})", path) from error
        if chunk is None:
            return
        yield chunk
