"""Files that were written again with the content that they had."""

from __future__ import annotations

import sqlite3
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from fusion.pipeline.catalog.digests import file_digest, file_status
from fusion.pipeline.catalog.rows import CATALOG_FILE, known_digest, with_checksum
from fusion.runtime.folders import Listing
from spcola.errors import SpcolaError

# More files, or more bytes, are left to the catalogue, which uses all cores.
_MOST, _MOST_BYTES = 100, 1 << 28
_STATES = "SELECT path, size || ',' || mtime_ns || ',' || ctime_ns || ',' || inode FROM file"
_WAIT_S = 0.1


def with_known_states(now: Listing, home: Path) -> Listing:
    """Return a listing with the earlier states of files whose content is the same.

    The catalogue knows the digest of each file in the state in which it was last looked at. A file
    in another state that has the same digest gets that earlier state, and the catalogue learns the
    new one. `now` itself is returned if there is no such file, if many files are in other states,
    or if one of them has another content.

    Parameters
    ----------
    now : Listing
    home : Path
        The folder of the solution whose catalogue is used; files elsewhere are left as they are.
    """
    files, rows, left = list(now.files), [], _MOST_BYTES
    try:
        with closing(sqlite3.connect(_address(home), timeout=_WAIT_S, uri=True)) as base:
            written = _in_other_states(now, base, f"{home}/")
            if not 0 < len(written) <= _MOST:
                return now
            for place, path, name in written:
                before = base.execute("SELECT * FROM file WHERE path = ?", (name,)).fetchone()
                row = _row_of_same(path, before, left)
                if row is None:
                    return now
                left -= row[1]
                rows.append(row)
                files[place] = f"{path}\0{','.join(map(str, before[1:5]))}"
            # It is a cache: where it cannot be written, nothing is lost but time.
            with suppress(sqlite3.Error), base:
                base.executemany("REPLACE INTO file VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
    except (OSError, SpcolaError, sqlite3.Error, ValueError):
        return now
    return Listing(now.begun_ns, files)


def _address(home: Path) -> str:
    """Return the catalogue as SQLite takes it if it is not to be created."""
    return f"{(home / CATALOG_FILE).absolute().as_uri()}?mode=rw"


def _in_other_states(
    now: Listing, base: sqlite3.Connection, home: str
) -> list[tuple[int, Path, str]]:
    """Return the files that are in another state than the catalogue knows: place, path, name."""
    stated, found = dict(base.execute(_STATES)), []
    for place, line in enumerate(now.files):
        path, _, state = line.partition("\0")
        if path.startswith(home) and stated.get(name := path[len(home) :], state) != state:
            found.append((place, Path(path), name))
    return found


def _row_of_same(path: Path, before: tuple[Any, ...], most_bytes: int) -> tuple[Any, ...] | None:
    """Return the row of a file as it is now; None unless its content is that of the row before."""
    begun, digest = time.time_ns(), known_digest(before, before[0], before[1:5])
    state = file_status(path)
    if digest is None or not path.is_file() or not state[0] == before[1] <= most_bytes:
        return None
    same = file_digest(path) == digest
    return with_checksum(before[0], *state, begun, digest) if same else None
