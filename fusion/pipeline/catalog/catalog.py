"""The catalogue of a workspace: what exists, made from what, by which settings and version."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
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
# These errors of sqlite are no damage of the file but of the disk, permissions, other programs.
_OUTSIDE = ("BUSY", "LOCKED", "CANTOPEN", "PERM", "FULL", "NOMEM", "AUTH", "IOERR", "INTERRUPT")


class Catalog:
    """An index over the records of ``provenance/``, with a cache of file digests.

    The records are separate files, one for each stage; the data base speeds up look-ups and has
    a second copy of them. If it is deleted or damaged, it is rebuilt from the records, and digests
    are computed again. Each row has a checksum; a row that fails it is ignored.

    Parameters
    ----------
    workspace : Workspace
    read_only : bool
        Whether the workspace is only read: if it cannot be written, results are kept in memory or
        not at all.

    Attributes
    ----------
    notes : list of str
        Messages on what was damaged and repaired.
    """

    def __init__(self, workspace: Workspace, *, read_only: bool = False) -> None:
        self.workspace = workspace
        self.path = workspace.home / CATALOG_FILE
        self.rebuilt = False
        self.notes: list[str] = []
        try:
            self._connect()
        except sqlite3.DatabaseError as error:
            if read_only and not _can_write(self.path):
                self._connect(":memory:")
                return
            self._repair(error)

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
        """Return the SHA-256 of each file, keyed by its name in the catalogue."""
        names = [self.workspace.relative(path) for path in paths]
        return dict(zip(names, self.digests_of(paths), strict=True))

    def digests_of(self, paths: Sequence[Path]) -> list[str]:
        """Return the SHA-256 of files; those of new or changed files are computed on all cores.

        Raises
        ------
        WorkspaceError
            If one cannot be read.
        """
        with self.digesting(paths) as found:
            return list(found)

    @contextmanager
    def digesting(self, paths: Sequence[Path]) -> Iterator[Iterator[str]]:
        """Yield the SHA-256 of files in their order, while the next ones are computed.

        Those that were computed are stored, even if not all are taken.

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
                made.append(_with_checksum(self.workspace.relative(path), *state, computed))
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
        """Return the stored digest of a file that is unchanged, or None."""
        name = self.workspace.relative(path)
        row = self._row("SELECT * FROM file WHERE path = ?", name)
        if row is None or row != _with_checksum(*row[:-1]):
            return None
        return str(row[-2]) if tuple(row[:-2]) == (name, *state) else None

    def record(self, stage: str) -> StageRecord | None:
        """Return how `stage` last ran; None if it never ran, or its record is lost or damaged."""
        return read_record(self.workspace, stage) or self._stored_record(stage)

    def restore(self) -> None:
        """Write lost or damaged records again, from the copies in the data base."""
        folder = self.workspace.home / RECORD_FOLDER
        there = {path.stem for path in folder.glob("*.json")}
        for stage in sorted(there | set(self._names())):
            if read_record(self.workspace, stage) is not None:
                continue
            kept, path = self._stored_record(stage), record_path(self.workspace, stage)
            state = "was damaged" if stage in there else "was gone"
            if kept is not None:
                write_record(self.workspace, kept)
                self.notes.append(f"{path} {state}; restored from {CATALOG_FILE}")
            else:
                self.notes.append(f"{path} {state}: stage {stage} will run again")

    def store(self, record: StageRecord) -> None:
        """Store how a stage ran: first the file, then the index."""
        write_record(self.workspace, record)
        self._index(record)

    def update_digests(self, stage: str, paths: Sequence[Path]) -> None:
        """Update the digests of rewritten files in the record of `stage`, if it has one."""
        record = self.record(stage)
        if record is not None:
            self.store(replace(record, outputs={**record.outputs, **self.digests(paths)}))

    def cached(self, name: str, key: str, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, in JSON types: the stored value if it has this `key`."""
        row = self._row("SELECT * FROM kept WHERE name = ?", name)
        if row is not None and row == _with_checksum(*row[:-1]) and row[1] == key:
            return json.loads(row[2])
        value = make()
        with self._caching() as base:
            rows = "INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?)"
            base.execute(rows, _with_checksum(name, key, json.dumps(value)))
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

    def _stored_record(self, stage: str) -> StageRecord | None:
        """Return the copy of a record; None if there is none, or it is damaged."""
        row = self._row("SELECT * FROM stage WHERE name = ?", stage)
        if row is None or row != _with_checksum(*row[:-1]):
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
            self._repair(error)
            return None
        return row

    def _index(self, record: StageRecord) -> None:
        with self._writing() as base:
            base.execute("DELETE FROM input WHERE stage = ?", (record.stage,))
            base.execute("DELETE FROM artefact WHERE stage = ?", (record.stage,))
            base.execute(
                "INSERT OR REPLACE INTO stage VALUES (?, ?, ?, ?)",
                _with_checksum(record.stage, record.key, json.dumps(record.as_dict())),
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
        """Open the data base; a new one gets its tables and the content of the records."""
        if not place and not self.path.exists():
            self._create()
        self._base = sqlite3.connect(place or self.path, timeout=10.0)
        if place:
            self._fill()
            return
        found = self._base.execute("PRAGMA user_version").fetchone()[0]
        if found != _SCHEMA_VERSION:
            raise sqlite3.DatabaseError(f"schema {found}")
        try:
            for table in ("artefact", "input", "kept", "stage", "file"):
                self._base.execute(f"SELECT * FROM {table} LIMIT 1").fetchone()
        except UnicodeDecodeError as error:
            # The module decodes the names of columns, also of a damaged file.
            raise sqlite3.DatabaseError("damaged") from error
        if self._base.execute("PRAGMA quick_check").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("damaged")

    def _create(self) -> None:
        """Make the data base, whole at once: other programs may open it at the same time."""
        temporary = self.path.with_name(f".{CATALOG_FILE}.{secrets.token_hex(4)}.part")
        self._base = sqlite3.connect(temporary)
        try:
            self._fill()
            self._base.close()
            os.link(temporary, self.path)
        except FileExistsError:
            # Another program was faster.
            pass
        except OSError:
            # There are no hard links; or a program that works here has removed it as left over.
            with suppress(FileNotFoundError):
                temporary.rename(self.path)
        finally:
            self._base.close()
            temporary.unlink(missing_ok=True)

    def _fill(self) -> None:
        self._base.executescript(f"{_SCHEMA} PRAGMA user_version = {_SCHEMA_VERSION};")
        for record in read_records(self.workspace):
            self._index(record)
            self.rebuilt = True

    def _repair(self, error: sqlite3.Error) -> None:
        """Replace a damaged data base by one made from the records.

        Raises
        ------
        WorkspaceError
            If it is not damaged but cannot be used, or cannot be replaced.
        """
        if not self._is_damage(error) or self.rebuilt:
            raise self._refusal(error) from error
        if hasattr(self, "_base"):
            self._base.close()
        # One that was moved has been replaced by another program.
        moved = "DBMOVED" in str(getattr(error, "sqlite_errorname", ""))
        try:
            if not moved:
                self.path.unlink(missing_ok=True)
                self.path.with_name(f"{CATALOG_FILE}-journal").unlink(missing_ok=True)
        except OSError as failure:
            raise WorkspaceError(f"cannot be replaced ({failure.strerror})", self.path) from failure
        if not moved and not str(error).startswith("schema"):
            self.notes.append(f"{self.path} was damaged; made again from {RECORD_FOLDER}/")
        self._connect()
        self.rebuilt = True

    def _is_damage(self, error: sqlite3.Error) -> bool:
        """Return whether the file is damaged, rather than closed to reading or writing."""
        name = str(getattr(error, "sqlite_errorname", ""))
        if "READONLY" in name:
            # A damaged header forbids writing too.
            return _can_write(self.path)
        return "SHORT_READ" in name or not any(f"SQLITE_{word}" in name for word in _OUTSIDE)

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """Open a transaction; what a damaged data base loses is in the records or recomputed."""
        try:
            with self._base:
                yield self._base
        except sqlite3.Error as error:
            self._repair(error)

    @contextmanager
    def _caching(self) -> Iterator[sqlite3.Connection]:
        """Open a transaction of cached values, which may be lost if the folder is read-only."""
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


def _with_checksum(*fields: Any) -> tuple[Any, ...]:
    """Return the fields of a row followed by their checksum."""
    text = "\0".join(str(field) for field in fields)
    return (*fields, hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest())


def _can_write(path: Path) -> bool:
    """Return whether a data base, and its journal in the same folder, can be written."""
    there = not path.exists() or os.access(path, os.W_OK)
    return there and os.access(path.parent, os.W_OK)
