"""What the operating system is told of files that are read once, from begin to end.

A mission's files are many times the memory of a machine. Without a word their pages push out those
of everything else, and each page is looked for anew although the one of the file before it is done.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def announce(descriptor: int, begin: int, count: int) -> None:
    """Say that `count` bytes from `begin` on will be read: the disk brings them meanwhile."""
    if hasattr(os, "posix_fadvise"):  # not on macOS and Windows
        # A pipe takes no hint.
        with suppress(OSError):
            os.posix_fadvise(descriptor, begin, count, os.POSIX_FADV_WILLNEED)


def release(path: Path) -> None:
    """Say that a file will not be read again soon: its pages serve the next one."""
    if hasattr(os, "posix_fadvise"):
        # It may be gone by now, which is nobody's loss.
        with suppress(OSError), path.open("rb") as stream:
            os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
