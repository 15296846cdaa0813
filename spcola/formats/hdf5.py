"""HDF5 files that are written whole or not at all."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from spcola.atomic import replacing


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
