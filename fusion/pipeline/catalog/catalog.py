"""The catalogue of a workspace: what exists, made from what, by which settings and version."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from fusion.pipeline.catalog.digests import FileStatus, digests_ahead, file_status
from fusion.pipeline.catalog.records import (
    RECORD_FOLDER,
    StageRecord,
    read_record,
    read_records,
    record_path,
    write_record,
)
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError

CATALOG_FILE = "catalog.sqlite"
_SCHEMA_VERSION = 2
_SCHEMA = """
CREATE TABLE file (path TEXT PRIMARY KEY, size INTEGER, mtime_ns INTEGER, ctime_ns INTEGER,
                   inode INTEGER, digest TEXT NOT NULL, seal TEXT NOT NULL);
CREATE TABLE stage (name TEXT PRIMARY KEY, key TEXT NOT NULL, record TEXT NOT NULL,
                    seal TEXT NOT NULL);
CREATE TABLE kept (name TEXT PRIMARY KEY, key TEXT NOT NULL, value TEXT NOT NULL,
                   seal TEXT NOT NULL);
CREATE TABLE input (stage TEXT, path TEXT, digest TEXT NOT NULL, PRIMARY KEY (stage, path));
CREATE TABLE artefact (path TEXT PRIMARY KEY, stage TEXT NOT NULL, digest TEXT NOT NULL);
"""
# What sqlite names thus is no damage of the file: another program, the disk, permissions.
_OUTSIDE = ("BUSY", "LOCKED", "CANTOPEN", "PERM", "FULL", "NOMEM", "AUTH", "IOERR", "INTERRUPT")


class Catalog:
    """An index over the records of ``provenance/``, with a cache of file digests.

    The records are files of their own, one for each stage; the data base only makes looking up
    fast, and has a second copy of them. Deleted or damaged, it is built again from the records, and
    digests are computed again. Each row has a checksum: one that fails it counts as none.

    Parameters
    ----------
    workspace : Workspace
    looking : bool
        Whether the workspace is only looked at: where it cannot be written, what is found out is
        kept in memory, or not at all.

    Attributes
    ----------
    notes : list of str
        What was found damaged and mended, for people.
    """

    def __init__(self, workspace: Workspace, *, looking: bool = False) -> None:
        self.workspace = workspace
        self.path = workspace.root / CATALOG_FILE
        self.rebuilt = False
        self.notes: list[str] = []
        try:
            self._connect()
        except sqlite3.DatabaseError as error:
            if looking and not _can_write(self.path):
                self._connect(":memory:")
                return
            self._mend(error)

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
        made: list[tuple[Any, ...]] = []

        def taken(fresh: Iterator[str]) -> Iterator[str]:
            for path, state, digest in zip(paths, stated, found, strict=True):
                if digest is not None:
                    yield digest
                    continue
                computed = next(fresh)
                made.append(_sealed(self.workspace.relative(path), *state, computed))
                yield computed

        try:
            with digests_ahead([paths[k] for k in missing]) as fresh:
                yield taken(fresh)
        finally:
            if made:
                with self._caching() as base:
                    rows = "INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?, ?, ?, ?)"
                    base.executemany(rows, made)

    def _known(self, path: Path, state: FileStatus) -> str | None:
        """Return the digest of a file that is as it was, or None."""
        name = self.workspace.relative(path)
        row = self._row("SELECT * FROM file WHERE path = ?", name)
        if row is None or row != _sealed(*row[:-1]):
            return None
        return str(row[-2]) if tuple(row[:-2]) == (name, *state) else None

    def record(self, stage: str) -> StageRecord | None:
        """Return how `stage` last ran, or None if it did not, or nothing sound tells it."""
        return read_record(self.workspace, stage) or self._kept(stage)

    def restore(self) -> None:
        """Write the records that were lost or damaged again, from the copies kept here."""
        folder = self.workspace.root / RECORD_FOLDER
        there = {path.stem for path in folder.glob("*.json")}
        for stage in sorted(there | set(self._names())):
            if read_record(self.workspace, stage) is not None:
                continue
            kept, path = self._kept(stage), record_path(self.workspace, stage)
            state = "was damaged" if stage in there else "was gone"
            if kept is not None:
                write_record(self.workspace, kept)
                self.notes.append(f"{path} {state}; restored from {CATALOG_FILE}")
            else:
                self.notes.append(f"{path} {state}: stage {stage} counts as one that never ran")

    def store(self, record: StageRecord) -> None:
        """Keep how a stage ran: first the file, then the index."""
        write_record(self.workspace, record)
        self._index(record)

    def rewritten(self, stage: str, paths: Sequence[Path]) -> None:
        """Note in the record of `stage`, if it has one, that files of it were written anew."""
        record = self.record(stage)
        if record is not None:
            self.store(replace(record, outputs={**record.outputs, **self.digests(paths)}))

    def remembered(self, name: str, key: str, make: Callable[[], Any]) -> Any:
        """Return what `make` gave, in JSON types, when it was last asked under this `key`."""
        row = self._row("SELECT * FROM kept WHERE name = ?", name)
        if row is not None and row == _sealed(*row[:-1]) and row[1] == key:
            return json.loads(row[2])
        value = make()
        with self._caching() as base:
            rows = "INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?)"
            base.execute(rows, _sealed(name, key, json.dumps(value)))
        return value

    def _names(self) -> list[str]:
        """Return the stages of which there is a copy of the record."""
        names = (
            self._row("SELECT name FROM stage LIMIT 1 OFFSET ?", number)
            for number in range(self._count())
        )
        return [str(row[0]) for row in names if row is not None]

    def _count(self) -> int:
        row = self._row("SELECT COUNT(*) FROM stage")
        return 0 if row is None else int(row[0])

    def _kept(self, stage: str) -> StageRecord | None:
        """Return the copy of a record, or None if there is none or it is damaged."""
        row = self._row("SELECT * FROM stage WHERE name = ?", stage)
        if row is None or row != _sealed(*row[:-1]):
            return None
        try:
            return StageRecord.from_dict(json.loads(row[2]))
        except (ValueError, KeyError, TypeError):
            return None

    def _row(self, query: str, *values: str | int) -> tuple[Any, ...] | None:
        """Return the first row of a query; None if there is none, or the data base was damaged."""
        try:
            row: tuple[Any, ...] | None = self._base.execute(query, values).fetchone()
        except sqlite3.Error as error:
            self._mend(error)
            return None
        return row

    def _index(self, record: StageRecord) -> None:
        with self._writing() as base:
            base.execute("DELETE FROM input WHERE stage = ?", (record.stage,))
            base.execute("DELETE FROM artefact WHERE stage = ?", (record.stage,))
            base.execute(
                "INSERT OR REPLACE INTO stage VALUES (?, ?, ?, ?)",
                _sealed(record.stage, record.key, json.dumps(record.as_dict())),
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
            try:
                for table in ("artefact", "input", "kept", "stage", "file"):
                    self._base.execute(f"SELECT * FROM {table} LIMIT 1").fetchone()
            except UnicodeDecodeError as error:
                # Names of columns are decoded by the module, whatever the rows are.
                raise sqlite3.DatabaseError("damaged") from error
            if self._base.execute("PRAGMA quick_check").fetchone()[0] != "ok":
                raise sqlite3.DatabaseError("damaged")
        if fresh:
            for record in read_records(self.workspace):
                self._index(record)
                self.rebuilt = True

    def _mend(self, error: sqlite3.Error) -> None:
        """Replace a damaged data base by one made from the records.

        Raises
        ------
        WorkspaceError
            If it is not damaged, but cannot be used, or it cannot be replaced.
        """
        if not self._is_damage(error) or self.rebuilt:
            raise self._refusal(error) from error
        if hasattr(self, "_base"):
            self._base.close()
        try:
            self.path.unlink(missing_ok=True)
            self.path.with_name(f"{CATALOG_FILE}-journal").unlink(missing_ok=True)
        except OSError as failure:
            raise WorkspaceError(f"cannot be replaced ({failure.strerror})", self.path) from failure
        if not str(error).startswith("schema"):
            self.notes.append(f"{self.path} was damaged; made again from {RECORD_FOLDER}/")
        self._connect()
        self.rebuilt = True

    def _is_damage(self, error: sqlite3.Error) -> bool:
        """Tell a damaged data base from one that cannot be opened, read or written."""
        name = str(getattr(error, "sqlite_errorname", ""))
        if "READONLY" in name:
            # A damaged header forbids writing too.
            return _can_write(self.path)
        return "SHORT_READ" in name or not any(f"SQLITE_{word}" in name for word in _OUTSIDE)

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """One transaction; what a damaged data base loses of it is in the records, or made anew."""
        try:
            with self._base:
                yield self._base
        except sqlite3.Error as error:
            self._mend(error)

    @contextmanager
    def _caching(self) -> Iterator[sqlite3.Connection]:
        """One transaction of what is made again where it cannot be kept: nobody may write here."""
        try:
            with self._writing() as base:
                yield base
        except WorkspaceError:
            if _can_write(self.path):
                raise

    def _refusal(self, error: sqlite3.Error) -> WorkspaceError:
        return WorkspaceError(
            f"cannot be used ({error})", self.path, "check the disk and the permissions"
        )


def _sealed(*fields: Any) -> tuple[Any, ...]:
    """Return the fields of a row with their checksum behind them."""
    text = "\0".join(str(field) for field in fields)
    return (*fields, hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest())


def _can_write(path: Path) -> bool:
    """Tell whether a data base, and the journal beside it, can be written."""
    there = not path.exists() or os.access(path, os.W_OK)
    return there and os.access(path.parent, os.W_OK)
