"""The catalogue of a workspace: what exists, made from what, by which settings and version."""

from __future__ import annotations

import json
import os
import secrets
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from fusion.pipeline.catalog.digests import digests_ahead
from fusion.pipeline.catalog.file_digest import file_status
from fusion.pipeline.catalog.records import (
    RECORD_FOLDER,
    StageRecord,
    read_record,
    read_records,
    record_path,
    recorded_stages,
    write_record,
)
from fusion.pipeline.catalog.rows import CATALOG_FILE, FileStatus, known_digest, with_checksum
from fusion.workspace import Workspace
from spcola.errors import WorkspaceError

_SCHEMA_VERSION = 3
_SCHEMA = """
CREATE TABLE file (path TEXT PRIMARY KEY, size INTEGER, mtime_ns INTEGER, ctime_ns INTEGER,
                   inode INTEGER, seen_ns INTEGER, digest TEXT NOT NULL, seal TEXT NOT NULL);
CREATE TABLE stage (name TEXT PRIMARY KEY, key TEXT NOT NULL, record TEXT NOT NULL,
                    seal TEXT NOT NULL);
CREATE TABLE kept (name TEXT PRIMARY KEY, key TEXT NOT NULL, value TEXT NOT NULL,
                   seal TEXT NOT NULL);
"""
# From so many files on all digests are loaded.
_MANY = 50
# These errors of sqlite are no damage of the file but of the disk, permissions, other programs.
_OUTSIDE = ("BUSY", "LOCKED", "CANTOPEN", "PERM", "FULL", "NOMEM", "AUTH", "IOERR", "INTERRUPT")


class Catalog:
    """A second copy of the records of ``provenance/``, with a cache of file digests.

    The records are separate files, one for each stage. If the data base is deleted or damaged, it
    is rebuilt from them, and digests are computed again. Each row has a checksum; a row that fails
    it is ignored.

    Parameters
    ----------
    workspace : Workspace
    read_only : bool
        Whether the workspace is only read, and as it is at one moment: each file and record is
        looked at once. If it cannot be written, results are kept in memory or not at all.

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
        self._seen: dict[str, str] | None = {} if read_only else None
        self._records: dict[str, StageRecord | None] | None = {} if read_only else None
        self._rows: dict[str, tuple[Any, ...]] = {}
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
        begun, names = time.time_ns(), [self.workspace.relative(path) for path in paths]
        if len(paths) > _MANY and not self._rows:
            self._load()
        seen = self._seen or {}
        fresh = [k for k, name in enumerate(names) if name not in seen]
        stated = {k: file_status(paths[k]) for k in fresh}
        known = {k: self._known(names[k], state) for k, state in stated.items()}
        missing = [k for k, digest in known.items() if digest is None]
        made: list[tuple[Any, ...]] = []

        def taken(computed: Iterator[str]) -> Iterator[str]:
            for k, name in enumerate(names):
                digest = seen[name] if k not in known else known[k]
                if digest is None:
                    digest = next(computed)
                    made.append(with_checksum(name, *stated[k], begun, digest))
                if self._seen is not None:
                    self._seen[name] = digest
                yield digest

        try:
            with digests_ahead([paths[k] for k in missing]) as computed:
                yield taken(computed)
        finally:
            if made:
                self._rows.update({str(row[0]): row for row in made} if self._rows else {})
                with self._caching() as base:
                    rows = "INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
                    base.executemany(rows, made)

    def recorded(self, record: StageRecord) -> dict[str, str | None]:
        """Return the SHA-256 of each output that a stage recorded; None for one that is gone."""
        digests = dict(self._seen or {})
        paths = {n: self.workspace.path_of(n) for n in record.outputs if n not in digests}
        there = {name: path for name, path in paths.items() if path.is_file()}
        digests |= zip(there, self.digests_of(list(there.values())), strict=True)
        return {name: digests.get(name) for name in record.outputs}

    def _load(self) -> None:
        """Read the digests of all files at once: a tenth of the time of many single look-ups."""
        try:
            self._rows = {row[0]: row for row in self._base.execute("SELECT * FROM file")}
        except sqlite3.Error as error:
            self._repair(error)

    def _known(self, name: str, state: FileStatus) -> str | None:
        """Return the stored digest of a file that is unchanged, or None."""
        row = self._rows.get(name) or self._row("SELECT * FROM file WHERE path = ?", name)
        return None if row is None else known_digest(row, name, state)

    def record(self, stage: str) -> StageRecord | None:
        """Return how `stage` last ran; None if it never ran, or its record is lost or damaged."""
        if self._records is None:
            return read_record(self.workspace, stage) or self._stored_record(stage)
        if stage not in self._records:
            found = read_record(self.workspace, stage) or self._stored_record(stage)
            self._records[stage] = found
        return self._records[stage]

    def records(self) -> list[StageRecord]:
        """Return the sound records of ``provenance/``, with those that solutions share."""
        found = (self.record(stage) for stage in recorded_stages(self.workspace))
        return [record for record in found if record is not None]

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
        if row is not None and row == with_checksum(*row[:-1]) and row[1] == key:
            return json.loads(row[2])
        value = make()
        with self._caching() as base:
            rows = "INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?)"
            base.execute(rows, with_checksum(name, key, json.dumps(value)))
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
        if row is None or row != with_checksum(*row[:-1]):
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
            base.execute(
                "INSERT OR REPLACE INTO stage VALUES (?, ?, ?, ?)",
                with_checksum(record.stage, record.key, json.dumps(record.as_dict())),
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
            for table in ("kept", "stage", "file"):
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


def _can_write(path: Path) -> bool:
    """Return whether a data base, and its journal in the same folder, can be written."""
    there = not path.exists() or os.access(path, os.W_OK)
    return there and os.access(path.parent, os.W_OK)
