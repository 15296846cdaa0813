"""Atomic writing of files: a file is either complete or absent."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from spcola.errors import DiskFullError, WorkspaceError

_ADVICE = {
    errno.ENOSPC: "free some space and run the command again: nothing was overwritten",
    errno.EDQUOT: "the disk quota is used up; free some space and run the command again",
    errno.EACCES: "check the permissions of the folder",
    errno.EROFS: "the file system is read-only",
    errno.ENOENT: "create the folder first",
}
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; on success it is flushed and renamed to `path`.

    Afterwards `path` has either its old content or the complete new one: a crash, Ctrl-C or a
    full disk cannot leave half a file under the final name.

    Raises
    ------
    WorkspaceError
        If the file cannot be written (full disk, permissions …); the temporary file is removed.
    """
    target = Path(path)
    temporary = target.parent / f".{target.name}.{secrets.token_hex(4)}.part"
    try:
        # A new file: its permissions are those that the process gives to any other.
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise write_error(target, error) from error
    try:
        yield temporary
        flush([temporary])
        temporary.replace(target)
    except OSError as error:
        raise write_error(target, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def flush(paths: Iterable[Path]) -> None:
    """Write files to the disk (fsync), or raise an OSError."""
    for path in paths:
        with path.open("rb") as stream:
            os.fsync(stream.fileno())


def flush_folders(root: Path) -> None:
    """Write the entries of a folder and of those in it to the disk, or raise an OSError.

    A file that was renamed has its new name after a power cut only when its folder is written.
    """
    for folder, _, _ in os.walk(root):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write `content` to `path` whole, or raise a WorkspaceError."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: str | Path, content: str) -> None:
    """Write `content` (UTF-8, its newlines kept) to `path` whole, or raise a WorkspaceError."""
    write_bytes(path, content.encode("utf-8"))


def write_error(path: Path, error: OSError) -> WorkspaceError:
    """Return a one-line error for an operating-system error while writing `path`."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    advice = _ADVICE.get(error.errno or 0, "check the disk and the folder")
    kind = DiskFullError if error.errno in _FULL else WorkspaceError
    return kind(f"cannot be written ({reason})", path, advice)
