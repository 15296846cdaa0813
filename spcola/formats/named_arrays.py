"""Files of named arrays."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np

from spcola.arrays import AnyArray

__all__ = ["read_arrays"]

# NumPy parses the headers of arrays as Python literals. In CPython up to 3.11.7 two threads that
# parse at once may fail: "AST constructor recursion depth mismatch" (CPython issue 106905).
_ONE_READER = threading.Lock()


def read_arrays(path: Path) -> dict[str, AnyArray]:
    """Return the arrays of a file of :func:`numpy.savez`; one thread reads at a time.

    Keys are their names. Each array has a checksum, which is verified.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OSError, ValueError, EOFError, KeyError, NotImplementedError, zipfile.BadZipFile
        If it cannot be read or is damaged.
    """
    # NumPy leaves a file open that is damaged.
    with (
        _ONE_READER,
        path.open("rb") as stream,
        np.load(stream, allow_pickle=False) as content,
    ):
        return dict(content)
