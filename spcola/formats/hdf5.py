"""HDF5 files that are written whole or not at all."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from spcola.atomic import replacing


@contextmanager
def new_hdf5(path: str | Path) -> Iterator[Any]:
    """Yield an empty HDF5 file.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    try:
        with h5py.File(path, "w") as file:
            yield file
    except RuntimeError as error:
        # HDF5 tells of a full disk in its own words, if it notices when it closes a file.
        number = re.search(r"errno = (\d+)", str(error))
        if number is None:
            raise
        raise OSError(int(number[1]), str(error)) from error


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
