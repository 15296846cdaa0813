"""Digests of files: on all cores, in order, and not far ahead of their use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from threading import Event

from fusion.pipeline.catalog.file_digest import file_digest, refused
from fusion.runtime import usable_cores
from spcola.formats.text import regular_size

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
    with refused(path):
        regular_size(path)
        return file_digest(path, stopped)
