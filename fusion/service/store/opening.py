"""A store is opened: made if there is none, checked, upgraded, set aside if it is damaged."""

from __future__ import annotations

import os
import secrets
import sqlite3
import time
from contextlib import suppress
from pathlib import Path

from fusion.runtime.folders import locked
from fusion.service.store.backup import check_version, damage_of, into_place, write_backup
from fusion.service.store.database import Database
from fusion.service.store.errors import StoreError, StoreFault
from fusion.service.store.schema import VERSION, make_tables, stored_version, upgrade_tables

_SIDE_FILES = ("-wal", "-shm")


def opened_database(url: str | Path, backups: Path | None) -> tuple[Database, list[str]]:
    """Return the data base of a store, ready for use, and notes on what was repaired.

    Parameters
    ----------
    url : str or Path
        As of :class:`Database`.
    backups : Path, optional
        Folder for a backup before an upgrade; of a file its own folder by default.

    Raises
    ------
    StoreError
        If it cannot be used, belongs to another program, or is of a later version.
    """
    database = Database(url)
    notes: list[str] = []
    try:
        if database.path is None:
            _prepare(database, backups)
        else:
            path = database.path
            _make_folder(path.parent)
            with locked(path.with_name(f"{path.name}.lock"), wait=True):
                notes = _sound_file(path)
                _prepare(database, backups or path.parent)
    except BaseException:
        database.close()
        raise
    return database, notes


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        what = f"cannot be made ({error.strerror})"
        raise StoreError(StoreFault.UNAVAILABLE, what, folder) from error


def _sound_file(path: Path) -> list[str]:
    """Make the file if there is none; if it is damaged, keep it aside. Return what was done."""
    notes = []
    if path.exists():
        try:
            damage = damage_of(path)
        except (OSError, sqlite3.Error) as error:
            what = f"cannot be read and written ({error})"
            do = "check the permissions of the file and its folder"
            raise StoreError(StoreFault.UNAVAILABLE, what, path, do) from error
        if not damage:
            return []
        aside = _move_aside(path)
        notes = [f"{path}: was damaged ({damage}); it is kept as {aside.name}, a new one was made"]
    _make_file(path)
    return notes


def _move_aside(path: Path) -> Path:
    aside = path.with_name(f"{path.name}.damaged-{_stamp()}")
    # The log goes with its file: in the place of a new one's it would be applied to that.
    for suffix in (*_SIDE_FILES, ""):
        with suppress(FileNotFoundError):
            path.with_name(path.name + suffix).replace(aside.with_name(aside.name + suffix))
    return aside


def _stamp() -> str:
    """Return part of a name that no other file has: the time, and some letters."""
    return f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime())}-{secrets.token_hex(2)}"


def _make_file(path: Path) -> None:
    """Make a new store under another name first: an empty file is always a damaged one."""
    draft = path.with_name(f"{path.name}.new")
    try:
        for suffix in ("", *_SIDE_FILES):
            draft.with_name(draft.name + suffix).unlink(missing_ok=True)
        # It contains hashes of tokens, and names of users: for the owner's eyes only.
        os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        database = Database(draft)
        with database.writing() as connection:
            make_tables(connection)
        database.close()
        into_place(draft, path)
    except OSError as error:
        what = f"cannot be written ({error.strerror})"
        raise StoreError(StoreFault.UNAVAILABLE, what, path) from error


def _prepare(database: Database, backups: Path | None) -> None:
    """Make the tables, or bring them up to this version after a backup."""
    with database.reading() as connection:
        version = stored_version(connection)
    check_version(version, database.name)
    if version == VERSION:
        # One that can only be read is refused now, not at the first job.
        with database.writing():
            return
    if version and backups is not None:
        write_backup(database, backups / f"store-version-{version}-{_stamp()}.sqlite")
    elif version:
        what = f"is of version {version}, and has to be upgraded"
        do = "name a folder for its backup"
        raise StoreError(StoreFault.OLDER_STORE, what, database.name, do)
    with database.writing() as connection:
        # Another program may have done it meanwhile.
        version = stored_version(connection)
        check_version(version, database.name)
        if version:
            upgrade_tables(connection, version)
        elif database.path is None:
            make_tables(connection)
        else:
            what = "is an SQLite file of another program"
            raise StoreError(StoreFault.DAMAGED, what, database.name, "name another file")
