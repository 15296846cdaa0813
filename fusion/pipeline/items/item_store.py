"""Finished items of a stage: kept under the digest of what went into them."""

from __future__ import annotations

import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import spcola
from fusion.pipeline.items.encoding import Encoded, decode, encode
from fusion.runtime.remaining import note_done, note_found
from spcola import atomic
from spcola.errors import WorkspaceError
from spcola.formats.named_arrays import read_arrays

Result = TypeVar("Result")

_TEXT = "value"


@dataclass(frozen=True)
class ItemStore:
    """Results of a pure function, kept in files named by the digest of its arguments.

    A result is found again whenever the function is called with the same arguments: after an
    interruption, for items that a new scan or a changed maplet does not touch, in another order,
    by another worker. A file is written whole or not at all. One that is damaged, or that another
    version of the program wrote, is computed again.

    Parameters
    ----------
    folder : Path
        Made at the first result.
    version : str
        Of program and stage: equal arguments give equal results within one version.
    """

    folder: Path
    version: str

    def result(self, function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
        """Return ``function(*arguments, **options)``: the kept result, or a new one, which is kept.

        Parameters
        ----------
        function : callable
            Pure: its result depends on the arguments and on nothing else.
        *arguments, **options
            Values that :func:`fusion.pipeline.items.encode` can write.

        Raises
        ------
        WorkspaceError
            If the result cannot be written.
        """
        name = f"{function.__module__}.{function.__qualname__}"
        path = self.folder / f"{encode((self.version, name, arguments, options)).digest}.npz"
        found, kept = _read(path)
        if found:
            note_found()
            return kept
        note_done()
        result = function(*arguments, **options)
        _write(path, result)
        return result

    def remove_unused(self, since: float) -> None:
        """Remove items that were neither made nor used since a time (of :func:`time.time`, s)."""
        if not self.folder.is_dir():
            return
        for path in self.folder.iterdir():
            # Times of files are coarser than the clock.
            if path.stat().st_mtime < since - 1.0:
                path.unlink(missing_ok=True)


def item_folder(home: Path, stage: str) -> Path:
    """Return where a stage keeps its items; `home` is the folder of the solution."""
    return home / ".items" / stage


def whole_version(stage: int) -> str:
    """Return the version of the program and of a stage, of which results are kept."""
    return f"{spcola.__version__}+{stage}"


def _read(path: Path) -> tuple[bool, Any]:
    """Return whether there is a sound result in a file, and the result."""
    try:
        content = read_arrays(path)
        text = content[_TEXT].tobytes().decode("ascii")
        arrays = [content[f"a{number}"] for number in range(len(content) - 1)]
        value = decode(Encoded(text, arrays))
        os.utime(path, (time.time(), time.time()))
    except (
        OSError, ValueError, KeyError, TypeError, AttributeError, ImportError, EOFError,
        zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RecursionError,
    ):  # fmt: skip
        return False, None
    return True, value


def _write(path: Path, value: Any) -> None:
    """Write a result whole or not at all."""
    encoded = encode(value)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkspaceError(f"cannot be created ({error.strerror})", path.parent) from error
    text = np.frombuffer(encoded.text.encode("ascii"), np.uint8)
    arrays = {f"a{number}": array for number, array in enumerate(encoded.arrays)}
    with atomic.replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **{_TEXT: text}, **arrays)
