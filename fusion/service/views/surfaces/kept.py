"""Arrays that took long to make, kept in files, so that a server that starts again has them."""

from __future__ import annotations

import os
from collections.abc import Hashable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

import spcola
from fusion.runtime import content_digest
from spcola import atomic
from spcola.arrays import AnyArray
from spcola.errors import SpcolaError
from spcola.formats.named_arrays import read_arrays


class KeptArrays:
    """Files of arrays in a folder, one for each key.

    A key contains what changes with the files that the arrays were made from: arrays are found
    under it or not at all, and are never out of date.

    Parameters
    ----------
    folder : Path
        It is made when something is kept.
    most_bytes : int
        Of all files together; the one used longest ago is removed first.
    """

    def __init__(self, folder: Path, most_bytes: int = 1 << 31) -> None:
        self._folder, self._most = folder, most_bytes

    def find(self, key: Hashable) -> dict[Hashable, AnyArray] | None:
        """Return the arrays of a key; None if they are not kept, or their file is damaged."""
        path = self._path(key)
        try:
            found: dict[Hashable, AnyArray] = {}
            found.update(read_arrays(path).items())
        except (OSError, ValueError, EOFError, KeyError, BadZipFile):
            return None
        with suppress(OSError):
            os.utime(path)
        return found

    def keep(self, key: Hashable, arrays: Mapping[Hashable, AnyArray]) -> None:
        """Keep the arrays of a key, if there is room and the folder can be written."""
        with suppress(OSError, SpcolaError):
            self._folder.mkdir(mode=0o700, exist_ok=True)
            with atomic.replacing(self._path(key)) as path, path.open("wb") as stream:
                named: Any = {str(name): values for name, values in arrays.items()}
                np.savez(stream, **named)
            self._remove_oldest()

    def _path(self, key: Hashable) -> Path:
        return self._folder / f"{content_digest([repr(key), spcola.__version__])[:40]}.npz"

    def _remove_oldest(self) -> None:
        files = [(path.stat(), path) for path in self._folder.glob("*.npz")]
        total = sum(status.st_size for status, _ in files)
        for status, path in sorted(files, key=lambda each: each[0].st_mtime_ns):
            if total <= self._most:
                break
            path.unlink(missing_ok=True)
            total -= status.st_size
