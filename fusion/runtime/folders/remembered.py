"""What was found out about a folder, kept as long as none of its files changes."""

from __future__ import annotations

import hashlib
import json
import os
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import spcola
from fusion.runtime.folders.ticks import may_hide_a_change
from fusion.runtime.json_values import content_digest, json_value
from spcola import atomic
from spcola.errors import SpcolaError

_FOLDER = "provenance"
# What a look at the folder changes itself.
_OWN = "catalog.sqlite"
_ITEMS = ".items"


class Listing(NamedTuple):
    """All files of a folder with their states, and when they began to be listed."""

    begun_ns: int
    files: list[str]

    @property
    def changed_ns(self) -> int:
        """The last status change of any file, ns since 1970."""
        return max(int(line.rpartition("\0")[2].split(",")[2]) for line in self.files)


@dataclass(frozen=True)
class Remembered:
    """What was found out about a folder.

    Size, times of modification and of status change, and inode of every file are compared, as for
    the catalogue's digests: 100,000 files take a third of a second. Hidden files do not count; of
    kept items only whether some came or went.

    Parameters
    ----------
    folder : Path
    what : str
        What was found out: the name of the hidden file that keeps it.
    """

    folder: Path
    what: str = "info"

    def find(
        self, now: Listing, *, known: Callable[[Listing, Mapping[str, Any]], Listing] | None = None
    ) -> dict[str, Any] | None:
        """Return what is remembered; None if there is nothing, or a file changed since.

        Parameters
        ----------
        now : Listing
            The folder as it is (:meth:`listing`).
        known : callable, optional
            Returns the listing, given what is remembered, with the earlier states of those files
            that were written again with the same content. What is remembered holds for these too,
            and is remembered for the states of `now`.
        """
        try:
            kept = json.loads(self._file.read_text(encoding="utf-8"))
            content, outside, key = kept["content"], kept["outside"], kept["key"]
            sound = kept["digest"] == content_digest([content, outside, key])
            same = all(_status(path) == stated for path, stated in outside.items())
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return None
        if not (sound and same and now.files):
            return None
        found = self._key(now)
        if key == found:
            return dict(content)
        then = now if known is None else known(now, content)
        if then is now or key != self._key(then):
            return None
        again = zip(now.files, then.files, strict=True)
        written = Listing(now.begun_ns, [line for line, before in again if line != before])
        if not may_hide_a_change(written.changed_ns, since=now.begun_ns):
            with suppress(OSError, SpcolaError):
                self._write(found, content, outside)
        return dict(content)

    def keep(self, before: Listing, content: Mapping[str, Any], outside: Iterable[Path]) -> None:
        """Remember `content`, in JSON types, if no file changed since they were listed.

        Nothing is kept in a folder that cannot be written, or that changed so late that a further
        change may not show.

        Parameters
        ----------
        before : Listing
            From :meth:`listing`, before `content` was found out.
        content : mapping
        outside : iterable of Path
            Further files on which it depends.
        """
        with suppress(OSError, SpcolaError, ValueError):
            now = self.listing()
            if not now.files or now.files != before.files:
                return
            if may_hide_a_change(now.changed_ns, since=before.begun_ns):
                return
            others = {str(path): _status(str(path)) for path in outside}
            self._write(self._key(now), json_value(content), others)

    def _write(
        self, key: str, content: Mapping[str, Any], outside: Mapping[str, list[int] | None]
    ) -> None:
        digest = content_digest([content, outside, key])
        kept = {"key": key, "outside": outside, "content": content, "digest": digest}
        if self._file.parent.is_dir():
            atomic.write_text(self._file, json.dumps(kept))

    @property
    def _file(self) -> Path:
        return self.folder / _FOLDER / f".{self.what}"

    def listing(self) -> Listing:
        """Return all files of the folder with their states; empty if it cannot be listed."""
        begun = time.time_ns()
        try:
            files = list(_files(self.folder))
        except OSError:
            files = []
        return Listing(begun, files)

    def _key(self, now: Listing) -> str:
        """Return a digest of files, kept items, program and machine."""
        items = [_status(str(path)) for path in sorted((self.folder / _ITEMS).glob("*"))]
        listed = hashlib.sha256("\n".join(now.files).encode("utf-8", "surrogateescape")).hexdigest()
        return content_digest([listed, items, spcola.__version__, os.cpu_count(), str(self.folder)])


def _files(folder: Path) -> Iterator[str]:
    """Yield the visible files below a folder with their states, sorted in each folder.

    Raises
    ------
    OSError
        If it cannot be listed, or a link leads nowhere.
    """
    waiting = [str(folder)]
    while waiting:
        found, inner = [], []
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                name = entry.name
                if name[0] == "." or name.startswith(_OWN):
                    continue
                status = entry.stat()
                if stat.S_ISDIR(status.st_mode):
                    inner.append(entry.path)
                    continue
                found.append(
                    f"{entry.path}\0{status.st_size},{status.st_mtime_ns},{status.st_ctime_ns},"
                    f"{status.st_ino}"
                )
        waiting += sorted(inner)
        found.sort()
        yield from found


def _status(path: str) -> list[int] | None:
    """Return what is unchanged as long as a file is; None if it cannot be reached."""
    try:
        status = Path(path).stat()
    except OSError:
        return None
    return [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
