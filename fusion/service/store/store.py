"""The store of the service: jobs, tokens, audit log, uploads."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from sqlalchemy import select

from fusion.service.store.audit import AuditLog
from fusion.service.store.backup import read_backup, write_backup
from fusion.service.store.errors import StoreError
from fusion.service.store.opening import opened_database
from fusion.service.store.queue import SqlQueue
from fusion.service.store.records import AuditEntry
from fusion.service.store.retention import Retention
from fusion.service.store.schema import SETTING
from fusion.service.store.tokens import Tokens
from fusion.service.store.uploads import Uploads

LAST_BACKUP, LAST_CLEANING = "last-backup", "last-cleaning"
"""What :meth:`Store.note_time` notes."""


class Store(SqlQueue):
    """What the service keeps, in an SQLite file or on a PostgreSQL server.

    Any number of processes and threads may use it at once. Each method is one transaction: a
    process that is killed leaves what was there before, or all of what it did.

    Parameters
    ----------
    url : str or Path
        Path of a file, or ``postgresql://user@host/name``. Tables are made if there are none, and
        those of an earlier version upgraded after a backup. A damaged file is kept under another
        name, and a new one is made.
    backups : Path, optional
        Folder for that backup; of a file its own folder by default.
    clock, monotonic : callable
        As of :class:`SqlQueue`.

    Attributes
    ----------
    notes : list of str
        What was repaired when it was opened; empty if nothing.
    tokens : Tokens
    audit : AuditLog
    uploads : Uploads
    retention : Retention

    Raises
    ------
    StoreError
        If it cannot be opened, or a later version of the program wrote it.
    """

    def __init__(
        self,
        url: str | Path,
        *,
        backups: Path | None = None,
        clock: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        database, self.notes = opened_database(url, backups)
        super().__init__(database, clock=clock, monotonic=monotonic)
        self.tokens = Tokens(database, clock)
        self.audit = AuditLog(database, clock)
        self.uploads = Uploads(database, clock)
        self.retention = Retention(database, clock)
        for note in self.notes:
            self.audit.add(AuditEntry("spcola", "store-rebuilt", details={"text": note}))

    def note_time(self, name: str) -> None:
        """Note that something happens now."""
        with self._database.writing() as connection:
            connection.execute(SETTING.delete().where(SETTING.c.name == name))
            connection.execute(SETTING.insert().values(name=name, value=repr(self._clock())))

    def noted_time(self, name: str) -> float:
        """Return when something happened last, seconds since 1970; NaN if never."""
        query = select(SETTING.c.value).where(SETTING.c.name == name)
        with self._database.reading() as connection:
            return float(connection.execute(query).scalar() or math.nan)

    def backup(self, path: str | Path) -> None:
        """Write all to a new SQLite file, as it is at one moment, while others go on.

        Raises
        ------
        StoreError
            If the file exists or cannot be written.
        """
        write_backup(self._database, Path(path))
        # Also one of a store on a full disk counts.
        with suppress(StoreError):
            self.audit.add(AuditEntry("spcola", "store-saved", target=Path(path).name))
            self.note_time(LAST_BACKUP)

    def restore(self, path: str | Path) -> None:
        """Replace all by a backup, also one of an earlier version or of the other kind of store.

        It is one transaction, so that servers and workers may go on. Tokens that are revoked now
        stay revoked; jobs that ran when the backup was made wait again.

        Raises
        ------
        StoreError
            If the file is missing, damaged, no backup, or of a later version.
        """
        read_backup(self._database, Path(path))
        self.audit.add(AuditEntry("spcola", "store-restored", target=Path(path).name))

    def close(self) -> None:
        """Close all connections."""
        self._database.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
