"""Backup of a store while it is used, into an SQLite file, and back into a store of either kind."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from sqlalchemy import Connection, MetaData, Table, select

from fusion.service.store.database import Database
from fusion.service.store.errors import StoreError, StoreFault
from fusion.service.store.schema import (
    TABLES,
    TOKEN,
    VERSION,
    stored_version,
    upgrade_tables,
)

_ROWS = 1000


def damage_of(path: Path) -> str:
    """Return what is wrong with an SQLite file; an empty text if it is sound.

    Raises
    ------
    sqlite3.Error
        If it cannot be read for a reason other than damage.
    """
    if path.stat().st_size == 0:
        return "is empty"
    try:
        with closing(sqlite3.connect(path)) as file:
            found = file.execute("PRAGMA integrity_check(1)").fetchone()[0]
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorname", "").startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")):
            return str(error)
        raise
    return "" if found == "ok" else " ".join(str(found).split())


def write_backup(database: Database, path: Path) -> None:
    """Write the content of a store, as it is at one moment, to a new SQLite file.

    Raises
    ------
    StoreError
        If the file exists or cannot be written.
    """
    if path.exists():
        raise StoreError(StoreFault.UNAVAILABLE, "exists already", path, "give another name")
    try:
        with tempfile.TemporaryDirectory(prefix=".backup-", dir=path.parent) as folder:
            draft = Path(folder, path.name)
            with database.translated():
                if database.path is not None:
                    with closing(sqlite3.connect(database.path)) as source:
                        source.execute("VACUUM INTO ?", [str(draft)])
                else:
                    _copy_to_file(database, draft)
            draft.chmod(0o600)
            into_place(draft, path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise StoreError(StoreFault.UNAVAILABLE, f"cannot be written ({reason})", path) from error


def into_place(draft: Path, path: Path) -> None:
    """Give a finished file its name, so that a power cut leaves it whole or not there."""
    for place in (draft, path.parent):
        if place == path.parent:
            draft.replace(path)
        descriptor = os.open(place, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _copy_to_file(database: Database, path: Path) -> None:
    path.touch()
    target = Database(path)
    try:
        with database.reading() as source, target.writing() as copy:
            tables = TABLES
            if stored_version(source) != VERSION:
                # Tables of an earlier version, as they are; their indexes are not needed.
                tables = MetaData()
                tables.reflect(source, only=lambda name, _: name in TABLES.tables)
                for table in tables.tables.values():
                    table.indexes.clear()
            tables.create_all(copy)
            for table in tables.tables.values():
                _copy_rows(table, source, copy)
    finally:
        target.close()


def _copy_rows(table: Table, source: Connection, target: Connection) -> None:
    for part in source.execute(select(table)).mappings().partitions(_ROWS):
        target.execute(table.insert(), [dict(row) for row in part])


def read_backup(database: Database, path: Path) -> None:
    """Replace the content of a store by a backup's, in one transaction.

    A token that is revoked now stays revoked. Jobs that ran when the backup was made wait again
    when their leases have ended.

    Raises
    ------
    StoreError
        If the backup is missing, damaged, no backup, or of a later version.
    """
    with (
        _current_copy(path) as backup,
        backup.reading() as source,
        database.writing() as target,
    ):
        query = select(TOKEN.c.id, TOKEN.c.revoked).where(TOKEN.c.revoked.is_not(None))
        revoked = list(target.execute(query))
        for table in TABLES.tables.values():
            target.execute(table.delete())
            _copy_rows(table, source, target)
        for identity, when in revoked:
            mine = (TOKEN.c.id == identity) & TOKEN.c.revoked.is_(None)
            target.execute(TOKEN.update().where(mine).values(revoked=when))


@contextmanager
def _current_copy(path: Path) -> Iterator[Database]:
    """Open a copy of a backup, brought up to this version."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "store.sqlite")
        try:
            shutil.copyfile(path, copy)
            damage = damage_of(copy)
        except (OSError, sqlite3.Error) as error:
            what = f"cannot be read ({getattr(error, 'strerror', None) or error})"
            raise StoreError(StoreFault.UNAVAILABLE, what, path) from error
        if damage:
            raise StoreError(StoreFault.DAMAGED, f"is damaged ({damage})", path)
        backup = Database(copy)
        try:
            with backup.writing() as connection:
                version = stored_version(connection)
                if version == 0:
                    raise StoreError(StoreFault.DAMAGED, "is no backup of a store", path)
                check_version(version, path)
                upgrade_tables(connection, version)
            yield backup
        finally:
            backup.close()


def check_version(version: int, where: str | Path) -> None:
    """Refuse a store that a later version of the program wrote."""
    if version > VERSION:
        what = f"is of version {version}, and this program knows versions up to {VERSION}"
        raise StoreError(StoreFault.NEWER_STORE, what, where, "use the newer spcola")
