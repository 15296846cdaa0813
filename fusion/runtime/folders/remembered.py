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
from typing import Any, NamedTuple, Self

import spcola
from fusion.runtime.folders.ticks import may_hide_a_change
from fusion.runtime.json_values import content_digest, json_value
from spcola import atomic
from spcola.errors import SpcolaError

__all__ = ["Listing", "Remembered", "Renewal", "Written"]

_FOLDER = "provenance"
# What a look at the folder changes itself.
_OWN = "catalog.sqlite"
_ITEMS = ".items"
_KEPT = {"key", "outside", "content", "since", "details"}
# With more files in other states all is found out anew.
_MOST = 100


class Listing(NamedTuple):
    """All files of a folder with their states, and when they began to be listed."""

    begun_ns: int
    files: list[str]

    @property
    def changed_ns(self) -> int:
        """The last status change of any file, ns since 1970."""
        return max(int(line.rpartition("\0")[2].split(",")[2]) for line in self.files)


class Written(NamedTuple):
    """A file that is in another state than when something was found out."""

    path: Path
    before: str
    now: str

    @classmethod
    def of_lines(cls, before: str, now: str) -> Self | None:
        """Return the file of two lines of listings; None if they are about different files."""
        (path, _, was), (same, _, state) = before.partition("\0"), now.partition("\0")
        return cls(Path(path), was, state) if path == same else None


class Renewal(NamedTuple):
    """What is remembered of a folder of which some files are in other states since.

    Attributes
    ----------
    content, details : dict
        As they were kept.
    written : list of Written
        All files in other states; none came or went.
    """

    content: dict[str, Any]
    details: dict[str, Any]
    written: list[Written]


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
        self,
        now: Listing,
        *,
        renewed: Callable[[Renewal], Mapping[str, Any] | None] | None = None,
    ) -> dict[str, Any] | None:
        """Return what is remembered; None if there is nothing, or a file changed since.

        Parameters
        ----------
        now : Listing
            The folder as it is (:meth:`listing`).
        renewed : callable, optional
            Returns what holds with some files in other states, or None if that has to be found out
            anew. It is asked if details were kept, and is remembered.
        """
        kept = self._kept()
        if kept is None or not now.files:
            return None
        found = self._key(now)
        if kept["key"] == found:
            return dict(kept["content"])
        if renewed is None or (asked := self._renewal(kept, now)) is None:
            return None
        renewal, since = asked
        if (content := renewed(renewal)) is None:
            return None
        changed = Listing(now.begun_ns, list(since.values()))
        if not may_hide_a_change(changed.changed_ns, since=now.begun_ns):
            with suppress(OSError, SpcolaError):
                new = {"key": found, "content": json_value(content), "since": since}
                self._write({**kept, **new})
        return dict(content)

    def keep(
        self,
        before: Listing,
        content: Mapping[str, Any],
        outside: Iterable[Path],
        details: Mapping[str, Any] | None = None,
    ) -> None:
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
        details : mapping, optional
            What is needed to renew `content` after a few files changed, in JSON types.
        """
        with suppress(OSError, SpcolaError, ValueError):
            now = self.listing()
            if not now.files or now.files != before.files:
                return
            if may_hide_a_change(now.changed_ns, since=before.begun_ns):
                return
            others = {str(path): _status(str(path)) for path in outside}
            kept = {"key": self._key(now), "outside": others, "content": json_value(content)}
            self._write({**kept, "since": {}, "details": self._write_details(details, now)})

    def _kept(self) -> dict[str, Any] | None:
        """Return what is kept if it is sound and no file outside has changed."""
        try:
            kept: dict[str, Any] = json.loads(self._file.read_text(encoding="utf-8"))
            digest = kept.pop("digest")
            sound = digest == content_digest(kept) and kept.keys() == _KEPT
            same = sound and all(_status(path) == was for path, was in kept["outside"].items())
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return None
        return kept if same else None

    def _write(self, kept: Mapping[str, Any]) -> None:
        if self._file.parent.is_dir():
            atomic.write_text(self._file, json.dumps({**kept, "digest": content_digest(kept)}))

    def _write_details(self, details: Mapping[str, Any] | None, now: Listing) -> str | None:
        """Write details and the listing to a file of their own; return its digest.

        They are needed only after a change, and a hundred times larger than the rest.
        """
        path = self._details_file
        if details is None or not path.parent.is_dir():
            return None
        lines = (json.dumps(json_value(details)), *now.files)
        text = "\n".join(lines).encode("utf-8", "surrogateescape")
        atomic.write_bytes(path, text)
        return hashlib.sha256(text).hexdigest()

    def _renewal(
        self, kept: Mapping[str, Any], now: Listing
    ) -> tuple[Renewal, dict[str, str]] | None:
        """Return what is to be renewed, and the lines that differ from the listing of the details.

        None unless a few files in other states are all that has changed.
        """
        try:
            text = self._details_file.read_bytes()
            if hashlib.sha256(text).hexdigest() != kept["details"]:
                return None
            head, *files = text.decode("utf-8", "surrogateescape").split("\n")
            for place, line in kept["since"].items():
                files[int(place)] = line
            details = json.loads(head)
        except (OSError, ValueError, IndexError):
            return None
        if len(files) != len(now.files) or self._key(Listing(0, files)) != kept["key"]:
            return None
        pairs = zip(files, now.files, strict=True)
        places = [place for place, (before, after) in enumerate(pairs) if before != after]
        written = [Written.of_lines(files[place], now.files[place]) for place in places[:_MOST]]
        found = [one for one in written if one is not None]
        if len(found) < len(places):
            return None
        since = {str(place): now.files[place] for place in places}
        return Renewal(dict(kept["content"]), details, found), {**kept["since"], **since}

    @property
    def _file(self) -> Path:
        return self.folder / _FOLDER / f".{self.what}"

    @property
    def _details_file(self) -> Path:
        return self.folder / _FOLDER / f".{self.what}-details"

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
