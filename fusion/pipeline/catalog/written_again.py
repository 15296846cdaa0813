"""Digests of files that were written since the catalogue last looked at them."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

from fusion.pipeline.catalog.file_digest import file_digest, file_status
from fusion.pipeline.catalog.rows import CATALOG_FILE, known_digest, with_checksum
from fusion.runtime.folders.remembered import Written
from spcola.errors import SpcolaError

# More bytes are left to the catalogue, which uses all cores.
_MOST_BYTES = 1 << 28
_WAIT_S = 0.1


class Redigested(NamedTuple):
    """A file that was written: its name in the catalogue, and its digests."""

    name: str
    before: str
    now: str


def digests_of_written(written: Sequence[Written], home: Path) -> list[Redigested] | None:
    """Return the digests of files before and after they were written.

    The catalogue knows the digest of each file in the state in which it was last looked at, and
    learns the new one. None is returned if it does not know a file in its state before, if a file
    changes meanwhile or cannot be read, or if the files are large.

    Parameters
    ----------
    written : sequence of Written
    home : Path
        The folder of the solution whose catalogue is used, and in which the files lie.
    """
    found, rows, left = [], [], _MOST_BYTES
    try:
        with closing(sqlite3.connect(_address(home), timeout=_WAIT_S, uri=True)) as base:
            for one in written:
                name = one.path.relative_to(home).as_posix()
                known = base.execute("SELECT * FROM file WHERE path = ?", (name,)).fetchone()
                row = None if known is None else _row_now(one, known, left)
                if row is None:
                    return None
                left -= row[1]
                rows.append(row)
                found.append(Redigested(name, str(known[6]), str(row[6])))
            # It is a cache: where it cannot be written, nothing is lost but time.
            with suppress(sqlite3.Error), base:
                base.executemany("REPLACE INTO file VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
    except (OSError, SpcolaError, sqlite3.Error, ValueError):
        return None
    return found


def _address(home: Path) -> str:
    """Return the catalogue as SQLite takes it if it is not to be created."""
    return f"{(home / CATALOG_FILE).absolute().as_uri()}?mode=rw"


def _row_now(one: Written, known: tuple[Any, ...], most_bytes: int) -> tuple[Any, ...] | None:
    """Return the row of a file as it is now; None if the row before is not of its state before."""
    begun, state = time.time_ns(), file_status(one.path)
    if _stated(state) != one.now or not one.path.is_file() or state[0] > most_bytes:
        return None
    if _stated(known[1:5]) != one.before or known_digest(known, known[0], known[1:5]) is None:
        return None
    return with_checksum(known[0], *state, begun, file_digest(one.path))


def _stated(state: Sequence[Any]) -> str:
    """Return a state as listings of folders have it."""
    return ",".join(map(str, state))
