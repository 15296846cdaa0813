"""The digest and the status of a file."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

from fusion.pipeline.catalog.rows import FileStatus
from fusion.runtime.machine import read_ahead
from spcola.errors import WorkspaceError

# Read at a time for a digest: small against the caches, large against a system call.
_BLOCK_BYTES = 1 << 20
# Announced ahead of the reading: the disk reads it while a block is digested.
_WINDOW_BYTES = 1 << 26


def file_digest(path: Path, stopped: Event | None = None) -> str:
    """Return the SHA-256 of a file, hexadecimal; meaningless once `stopped` is set."""
    digest, block = hashlib.sha256(), memoryview(bytearray(_BLOCK_BYTES))
    with path.open("rb", buffering=0) as stream:
        announced = done = 0
        while True:
            if done >= announced - _WINDOW_BYTES // 2:
                read_ahead(stream.fileno(), announced, _WINDOW_BYTES)
                announced += _WINDOW_BYTES
            count = stream.readinto(block)
            if not count or (stopped and stopped.is_set()):
                break
            digest.update(block[:count])
            done += count
    return digest.hexdigest()


def file_status(path: Path) -> FileStatus:
    """Return what is unchanged as long as the content of a file is.

    Size, time of last modification and of last status change (both ns; programs that edit in place
    or copy may set back the former but not the latter) and inode.

    Raises
    ------
    WorkspaceError
        If it is not there, a folder, or closed to this user.
    """
    with refused(path):
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not os.access(path, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        return status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino


@contextmanager
def refused(path: Path) -> Iterator[None]:
    """Turn an error of reading a file into one line."""
    try:
        yield
    except OSError as error:
        raise WorkspaceError(
            f"cannot be read ({error.strerror})",
            path,
            "restore it, or take its name off the list that holds it"
            if error.errno == errno.ENOENT
            else "check that it is a file, and its permissions",
        ) from error
