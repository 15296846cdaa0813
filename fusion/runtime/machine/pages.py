"""Hints to the operating system on files that are read once, from begin to end.

A mission's files are many times the memory of a machine. Without hints their pages displace all
others in the cache.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def read_ahead(descriptor: int, begin: int, count: int) -> None:
    """Announce that `count` bytes from `begin` will be read: the system reads them ahead."""
    if hasattr(os, "posix_fadvise"):  # not on macOS and Windows
        # A pipe takes no hint.
        with suppress(OSError):
            os.posix_fadvise(descriptor, begin, count, os.POSIX_FADV_WILLNEED)


def forget_pages(path: Path) -> None:
    """Announce that a file will not be read again soon: its pages serve the next one."""
    if hasattr(os, "posix_fadvise"):
        # It may be gone by now, which does not matter.
        with suppress(OSError), path.open("rb") as stream:
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
