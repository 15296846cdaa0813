"""HDF5 files that are written whole or not at all, and whose attributes have a checksum."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from spcola.atomic import replacing

DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, OverflowError)
"""What h5py raises while it reads a damaged file."""

_SEAL = "seal"


class _Patient(io.FileIO):
    """A file that notes that it could not be written, and goes on as if it had been.

    HDF5 does not bear errors of the disk: what it could not write it tries to write again whenever
    an object is closed, and in the end it brings the interpreter down.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of `data`, unless an earlier write failed."""
        view = memoryview(data).cast("B")
        done = len(view) if self.error else 0
        try:
            # A plain file may write less than it is asked to.
            while done < len(view):
                done += super().write(view[done:]) or 0
        except OSError as error:
            self.error = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Change the size, unless an earlier write failed."""
        try:
            if self.error is None:
                return super().truncate(size)
        except OSError as error:
            self.error = error
        return self.tell() if size is None else size


@contextmanager
def new_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file.

    Raises
    ------
    OSError
        If it could not be written; at the end of the block.
    """
    with _Patient(path, "w+") as raw:
        try:
            with h5py.File(raw, "w") as file:
                yield file
        except (RuntimeError, OSError):
            # What cannot be read back was not written.
            if raw.error is None:
                raise
        if raw.error is not None:
            raise raw.error


@contextmanager
def replacing_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file that takes the place of `path` when the block ends without an error.

    Raises
    ------
    WorkspaceError
        If it cannot be written; what was there before stays.
    """
    with replacing(path) as temporary, new_hdf5(temporary) as file:
        yield file


def seal(file: Any) -> None:
    """Give a file a checksum of all that it holds but the values of its datasets, as `sealed`."""
    file.attrs[_SEAL] = _digest(file)


def sealed(file: Any) -> bool | None:
    """Tell whether a file is as `seal` left it; None if it has no such checksum.

    It covers the names of all groups and datasets, their attributes, and types and shapes of
    datasets; not their values, which are to have checksums among the attributes.
    """
    stated = file.attrs.get(_SEAL)
    return None if stated is None else bool(stated == _digest(file))


def _digest(file: Any) -> str:
    """SHA-256 over all nodes of a file, hexadecimal."""
    digest = hashlib.sha256()

    def add(name: str, node: Any) -> None:
        attributes = {
            key: np.asarray(value).tolist() if not isinstance(value, str) else value
            for key, value in node.attrs.items()
            if key != _SEAL
        }
        form = [node.dtype.str, list(node.shape)] if isinstance(node, h5py.Dataset) else []
        digest.update(json.dumps([name, form, attributes], sort_keys=True).encode())

    add("/", file)
    file.visititems(add)
    return digest.hexdigest()
