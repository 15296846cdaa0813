"""Arrays that were made from files, kept as long as there is room and the files are the same."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path

from fusion.runtime import content_digest
from fusion.runtime.folders import Remembered
from fusion.service.views.surfaces.kept import KeptArrays
from spcola.arrays import AnyArray
from spcola.errors import WorkspaceError

Stamp = tuple[tuple[str, int, int, int], ...]


def stamp_of(*paths: Path) -> Stamp:
    """Return what changes whenever one of some files does: path, size, time and inode of each.

    Raises
    ------
    WorkspaceError
        If one is not there.
    """
    found = []
    for path in paths:
        try:
            status = path.stat()
        except OSError as error:
            raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
        found.append((str(path), status.st_size, status.st_mtime_ns, status.st_ino))
    return tuple(found)


def state_of(*folders: Path) -> str:
    """Return what changes whenever a visible file of some folders does.

    The files are listed, not opened: a thousandth of the time.
    """
    return content_digest([Remembered(folder).listing().files for folder in folders])


class LayerCache:
    """The layers used last; usable from several threads.

    Parameters
    ----------
    most_bytes : int
        Of all arrays together; the one used longest ago is dropped first.
    folder : Path, optional
        Where those that took long to make are kept in files as well.
    """

    def __init__(self, most_bytes: int = 1 << 29, folder: Path | None = None) -> None:
        self._files = None if folder is None else KeptArrays(folder)
        self._most, self._bytes = most_bytes, 0
        self._kept: OrderedDict[Hashable, AnyArray] = OrderedDict()
        self._lock = threading.Lock()
        self._making: dict[Hashable, threading.Lock] = {}

    def find(
        self,
        key: Hashable,
        part: Hashable,
        make: Callable[[], dict[Hashable, AnyArray]],
        *,
        slow: bool = False,
    ) -> AnyArray:
        """Return the array `part` of what `make` gives, made once for each `key`.

        Parameters
        ----------
        key : hashable
            Of the arrays that are made together.
        part : hashable
            One of their keys.
        make : callable
            Makes all of them; another thread that asks for the same key waits.
        slow : bool
            Whether that takes long: they are kept in a file, too.
        """
        found = self._get((key, part))
        if found is not None:
            return found
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        try:
            with making:
                found = self._get((key, part))
                if found is None:
                    made = self._made(key, make) if slow else make()
                    for name, values in made.items():
                        self._put((key, name), values)
                    found = made[part]
        finally:
            with self._lock:
                self._making.pop(key, None)
        return found

    def _made(
        self, key: Hashable, make: Callable[[], dict[Hashable, AnyArray]]
    ) -> dict[Hashable, AnyArray]:
        """Return the arrays of a key from their file, or made, and then kept in it."""
        if self._files is None:
            return make()
        made = self._files.find(key)
        if made is None:
            made = make()
            self._files.keep(key, made)
        return made

    def _get(self, key: Hashable) -> AnyArray | None:
        with self._lock:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            return self._kept[key]

    def _put(self, key: Hashable, values: AnyArray) -> None:
        values.setflags(write=False)
        with self._lock:
            self._bytes += values.nbytes - getattr(self._kept.pop(key, None), "nbytes", 0)
            self._kept[key] = values
            while self._bytes > self._most and len(self._kept) > 1:
                self._bytes -= self._kept.popitem(last=False)[1].nbytes
