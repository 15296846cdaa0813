"""Binary tables of equal records, mapped into memory piece by piece."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spcola.errors import FormatError

_PROBES = 64


def check_whole(path: Path, there: int, wanted: int, record: np.dtype[Any]) -> None:
    """Refuse a table of which `there` bytes are present where `wanted` records should be.

    Raises
    ------
    FormatError
        With the number of the record in which the file ends.
    """
    whole, rest = divmod(max(there, 0), record.itemsize)
    if whole < wanted:
        raise FormatError(
            f"is truncated: record {whole + 1} of {wanted} has {rest} of {record.itemsize} bytes",
            path,
            "fetch the file again",
        )


def mapped_chunks(
    path: Path, record: np.dtype[Any], count: int, chunk: int, begin: int = 0
) -> Iterator[NDArray[Any]]:
    """Yield `count` records from byte `begin` on, at most `chunk` at once.

    Each piece has a map of its own, so that pages read long ago do not count as memory in use.
    """
    for start in range(0, count, chunk):
        yield np.memmap(
            path,
            dtype=record,
            mode="r",
            offset=begin + start * record.itemsize,
            shape=(min(chunk, count - start),),
        )


def probed(path: Path, record: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return some of the `count` records of a file, spread over it; for recognising it."""
    table = np.memmap(path, dtype=record, mode="r", shape=(count,))
    probes: NDArray[Any] = table[np.unique(np.linspace(0, count - 1, _PROBES).astype(int))]
    return probes
