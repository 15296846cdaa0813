"""Digests of files: on all cores, in order, and not far ahead of their use."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from threading import Event

from fusion.pipeline.catalog.rows import FileStatus
from fusion.runtime import usable_cores
from fusion.runtime.machine import read_ahead
from spcola.errors import WorkspaceError
from spcola.formats.text import regular_size

# Read at a time for a digest: small against the caches, large against a system call.
_BLOCK_BYTES = 1 << 20
# Announced ahead of the reading: the disk reads it while a block is digested.
_WINDOW_BYTES = 1 << 26
# Files per core whose digests are computed ahead: a file is then still in the system's cache when
# its content is read.
_AHEAD = 2


@dataclass(frozen=True)
class FileDigests:
    """Digests of files, each of which is read once in this process."""

    known: dict[Path, str] = field(default_factory=dict)

    def __call__(self, path: Path) -> str:
        """Return the digest of a file."""
        if path not in self.known:
            self.known[path] = file_digest(path)
        return self.known[path]


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
    with _refused(path):
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not os.access(path, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        return status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino


@contextmanager
def digests_ahead(paths: Sequence[Path]) -> Iterator[Iterator[str]]:
    """Yield the SHA-256 of files in their order, computed ahead on all cores.

    The caller works while the next are computed. What is not taken is dropped at the end.

    Raises
    ------
    WorkspaceError
        If one cannot be read, when its digest is taken.
    """
    if len(paths) == 1:
        # Not on a thread: Ctrl-C could not stop it while it waits for the file.
        yield (_readable_digest(path) for path in paths)
        return
    stopped, cores = Event(), usable_cores()
    pool = ThreadPoolExecutor(cores, thread_name_prefix="digest")
    rest = iter(paths)
    waiting: deque[Future[str]] = deque()

    def begin(count: int) -> None:
        waiting.extend(pool.submit(_readable_digest, path, stopped) for path in islice(rest, count))

    def taken() -> Iterator[str]:
        while waiting:
            digest = waiting.popleft().result()
            begin(1)
            yield digest

    try:
        begin(_AHEAD * cores)
        yield taken()
    finally:
        stopped.set()
        pool.shutdown(wait=False, cancel_futures=True)


def _readable_digest(path: Path, stopped: Event | None = None) -> str:
    with _refused(path):
        regular_size(path)
        return file_digest(path, stopped)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
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
