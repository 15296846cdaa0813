"""The catalogue of a workspace: what exists, made from what, by which settings and version."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from fusion.digests import digests_ahead, file_status
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError

CATALOG_FILE = "catalog.sqlite"
RECORD_FOLDER = "provenance"
_SCHEMA_VERSION = 1
_SCHEMA = """
CREATE TABLE file (path TEXT PRIMARY KEY, size INTEGER, mtime_ns INTEGER, inode INTEGER,
                   digest TEXT NOT NULL);
CREATE TABLE stage (name TEXT PRIMARY KEY, key TEXT NOT NULL, record TEXT NOT NULL);
CREATE TABLE input (stage TEXT, path TEXT, digest TEXT NOT NULL, PRIMARY KEY (stage, path));
CREATE TABLE artefact (path TEXT PRIMARY KEY, stage TEXT NOT NULL, digest TEXT NOT NULL);
"""


@dataclass(frozen=True)
class StageRecord:
    """How a stage last ran.

    Parameters
    ----------
    stage : str
    key : str
        Digest of what follows but the outputs: equal keys give equal results.
    version : str
        Of the program and of the stage.
    settings : mapping
        The declared tables, as they were.
    inputs, outputs : mapping of str to str
        Path (relative to the workspace where inside it) → SHA-256.
    summary : mapping
        What the stage reported.
    finished : str
        UTC, ISO 8601.
    """

    stage: str
    key: str
    version: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    summary: Mapping[str, Any]
    finished: str

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Rebuild from :func:`dataclasses.asdict`; KeyError if something is missing."""
        return cls(**{name: content[name] for name in cls.__dataclass_fields__})


class Catalog:
    """An index over the records of ``provenance/``, with a cache of file digests.

    The records are files of their own, one for each stage; the data base only makes looking up
    fast. Deleted or damaged, it is built again from the records, and digests are computed again.

    Parameters
    ----------
    workspace : Workspace
    looking : bool
        Whether the workspace is only looked at: where it cannot be written, what is found out is
        kept in memory, or not at all.
    """

    def __init__(self, workspace: Workspace, *, looking: bool = False) -> None:
        self.workspace = workspace
        self._looking = looking
        self.path = workspace.root / CATALOG_FILE
        self.rebuilt = False
        try:
            self._connect()
        except sqlite3.DatabaseError as error:
            if looking and not _can_write(self.path):
                self._connect(":memory:")
                return
            if isinstance(error, sqlite3.OperationalError) and not _is_damage(error):
                raise self._refusal(error) from error
            self._discard()
            self._connect()

    def close(self) -> None:
        """Close the data base."""
        self._base.close()

    def digest(self, path: Path) -> str:
        """Return the SHA-256 of a file; computed only if the file changed since the last time.

        Raises
        ------
        WorkspaceError
            If it cannot be read.
        """
        return self.digests_of([path])[0]

    def digests(self, paths: Sequence[Path]) -> dict[str, str]:
        """Return the SHA-256 of files by their names in the catalogue."""
        names = [self.workspace.relative(path) for path in paths]
        return dict(zip(names, self.digests_of(paths), strict=True))

    def digests_of(self, paths: Sequence[Path]) -> list[str]:
        """Return the SHA-256 of files; of those that are new or changed on all cores.

        Raises
        ------
        WorkspaceError
            If one cannot be read.
        """
        with self.digesting(paths) as found:
            return list(found)

    @contextmanager
    def digesting(self, paths: Sequence[Path]) -> Iterator[Iterator[str]]:
        """Give the SHA-256 of files in their order, while those that follow are made.

        Those that are made are kept, also if not all are taken.

        Raises
        ------
        WorkspaceError
            If one cannot be read: at once if it is not there, or closed to this user.
        """
        stated = [file_status(path) for path in paths]
        found = [self._known(path, state) for path, state in zip(paths, stated, strict=True)]
        missing = [k for k, digest in enumerate(found) if digest is None]
        made: list[tuple[str, int, int, int, str]] = []

        def taken(fresh: Iterator[str]) -> Iterator[str]:
            for path, state, digest in zip(paths, stated, found, strict=True):
                if digest is not None:
                    yield digest
                    continue
                computed = next(fresh)
                made.append((self.workspace.relative(path), *state, computed))
                yield computed

        try:
            with digests_ahead([paths[k] for k in missing]) as fresh:
                yield taken(fresh)
        finally:
            if made:
                with self._writing() as base:
                    rows = "INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?, ?)"
                    base.executemany(rows, made)

    def _known(self, path: Path, state: tuple[int, int, int]) -> str | None:
        """Return the digest of a file that is as it was, or None."""
        row = self._base.execute(
            "SELECT size, mtime_ns, inode, digest FROM file WHERE path = ?",
            (self.workspace.relative(path),),
        ).fetchone()
        return str(row[3]) if row is not None and tuple(row[:3]) == state else None

    def record(self, stage: str) -> StageRecord | None:
        """Return how `stage` last ran, or None if it did not."""
        row = self._base.execute("SELECT record FROM stage WHERE name = ?", (stage,)).fetchone()
        return None if row is None else StageRecord.from_dict(json.loads(row[0]))

    def store(self, record: StageRecord) -> None:
        """Keep how a stage ran: first the file, then the index."""
        self.workspace.write_json(f"{RECORD_FOLDER}/{record.stage}.json", asdict(record))
        self._index(record)

    def _index(self, record: StageRecord) -> None:
        with self._writing() as base:
            base.execute("DELETE FROM input WHERE stage = ?", (record.stage,))
            base.execute("DELETE FROM artefact WHERE stage = ?", (record.stage,))
            base.execute(
                "INSERT OR REPLACE INTO stage VALUES (?, ?, ?)",
                (record.stage, record.key, json.dumps(asdict(record))),
            )
            base.executemany(
                "INSERT INTO input VALUES (?, ?, ?)",
                [(record.stage, path, digest) for path, digest in record.inputs.items()],
            )
            base.executemany(
                "INSERT OR REPLACE INTO artefact VALUES (?, ?, ?)",
                [(path, record.stage, digest) for path, digest in record.outputs.items()],
            )

    def _connect(self, place: str = "") -> None:
        """Open the data base; an empty one gets its tables and what the records hold."""
        fresh = bool(place) or not self.path.exists()
        self._base = sqlite3.connect(place or self.path, timeout=10.0)
        found = self._base.execute("PRAGMA user_version").fetchone()[0]
        if found != _SCHEMA_VERSION:
            if not fresh:
                raise sqlite3.DatabaseError(f"schema {found}")
            self._base.executescript(f"{_SCHEMA} PRAGMA user_version = {_SCHEMA_VERSION};")
        else:
            for table in ("artefact", "input", "stage", "file"):
                self._base.execute(f"SELECT 1 FROM {table} LIMIT 1").fetchone()
            if self._base.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                raise sqlite3.DatabaseError("damaged")
        if fresh:
            for record in read_records(self.workspace):
                self._index(record)
                self.rebuilt = True

    def _discard(self) -> None:
        """Remove a damaged data base; the records stay."""
        if hasattr(self, "_base"):
            self._base.close()
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise WorkspaceError(f"cannot be replaced ({error.strerror})", self.path) from error

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction; what the data base cannot do becomes one line."""
        try:
            with self._base:
                yield self._base
        except sqlite3.Error as error:
            if not self._looking:
                raise self._refusal(error) from error

    def _refusal(self, error: sqlite3.Error) -> WorkspaceError:
        return WorkspaceError(
            f"cannot be used ({error})", self.path, "check the disk and the permissions"
        )


def _can_write(path: Path) -> bool:
    """Tell whether a data base, and the journal beside it, can be written."""
    there = not path.exists() or os.access(path, os.W_OK)
    return there and os.access(path.parent, os.W_OK)


def _is_damage(error: sqlite3.OperationalError) -> bool:
    """Tell a damaged data base (tables missing, not one at all) from one that cannot be opened."""
    return "no such table" in str(error) or "malformed" in str(error)


def read_records(workspace: Workspace) -> list[StageRecord]:
    """Return the records in ``provenance/``; one that cannot be understood counts as none.

    A stage without a record is due, so that a damaged record costs time and never a wrong result.
    """
    records = []
    for path in sorted((workspace.root / RECORD_FOLDER).glob("*.json")):
        try:
            records.append(StageRecord.from_dict(json.loads(path.read_text(encoding="utf-8"))))
        except (ValueError, KeyError, TypeError):
            continue
        except OSError as error:
            raise WorkspaceError(f"cannot be read ({error.strerror})", path) from error
    return records


def content_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of JSON content, hexadecimal; the order of keys does not matter."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
