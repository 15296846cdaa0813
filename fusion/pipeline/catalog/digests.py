"""Digests of files: on all cores, in order, and not far ahead of who asks for them."""

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

from fusion.runtime import usable_cores
from fusion.runtime.machine import announce
from spcola.errors import WorkspaceError
from spcola.formats.text import regular_size

FileStatus = tuple[int, int, int, int]

# Read at a time for a digest: little beside the caches, much beside a system call.
_BLOCK_BYTES = 1 << 20
# Asked for ahead of the reading: what the disk brings while a block is worked on.
_WINDOW_BYTES = 1 << 26
# Files per core whose digests are made ahead: what is read for its digest is still in the
# system's memory when it is read for its content.
_AHEAD = 2


@dataclass(frozen=True)
class FileDigests:
    """Digests of files, each of which is read once; another process reads them again."""

    known: dict[Path, str] = field(default_factory=dict)

    def __call__(self, path: Path) -> str:
        """Return the digest of a file."""
        if path not in self.known:
            self.known[path] = file_digest(path)
        return self.known[path]


def file_digest(path: Path, stopped: Event | None = None) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal; of some of them once `stopped` is set."""
    digest, block = hashlib.sha256(), memoryview(bytearray(_BLOCK_BYTES))
    with path.open("rb", buffering=0) as stream:
        announced = done = 0
        while True:
            if done >= announced - _WINDOW_BYTES // 2:
                announce(stream.fileno(), announced, _WINDOW_BYTES)
                announced += _WINDOW_BYTES
            count = stream.readinto(block)
            if not count or (stopped and stopped.is_set()):
                break
            digest.update(block[:count])
            done += count
    return digest.hexdigest()


def file_status(path: Path) -> FileStatus:
    """Return what stays of a file as long as its digest does.

    Size, time of its last writing, time of its last change (both ns; nobody can set the latter
    back, as programs that edit in place or copy do with the former) and inode.

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
    """Give the SHA-256 of files in their order; the first are begun at once, on all cores.

    Whoever takes them works while the next are made. What is not taken is left when it ends.

    Raises
    ------
    WorkspaceError
        If one cannot be read, when its digest is taken.
    """
    if len(paths) == 1:
        # Not on a thread: Ctrl-C could not stop it where the file keeps it waiting.
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
    """Say in one line that a file cannot be read."""
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
