"""Connections to SQLite and PostgreSQL: one writer at a time, and errors in the store's words."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, DisconnectionError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from sqlalchemy.pool import QueuePool

from fusion.service.store.errors import StoreError, StoreFault
from spcola.errors import InvalidValueError

_BUSY_S = 20.0
_WRITERS_LOCK = 0x5350434F4C41  # "SPCOLA": the advisory lock of PostgreSQL that writers take
_SQLITE_PREFIX = "sqlite:///"
_SQLITE_FAULTS = {
    "BUSY": (StoreFault.BUSY, "another program writes to it for too long"),
    "LOCKED": (StoreFault.BUSY, "another program writes to it for too long"),
    "FULL": (StoreFault.DISK_FULL, "no space is left on the disk"),
    "CORRUPT": (StoreFault.DAMAGED, "is damaged"),
    "NOTADB": (StoreFault.DAMAGED, "is not an SQLite data base"),
    "CANTOPEN": (StoreFault.UNAVAILABLE, "cannot be opened: check its permissions"),
    "READONLY": (StoreFault.UNAVAILABLE, "cannot be written: check its permissions"),
}
_POSTGRESQL_FAULTS = {
    "53100": (StoreFault.DISK_FULL, "no space is left on the disk of the server"),
    "55P03": (StoreFault.BUSY, "another program writes to it for too long"),
    "57014": (StoreFault.BUSY, "a statement took too long"),
}


class Database:
    """A data base in a file (SQLite) or on a server (PostgreSQL).

    Writers come one after the other on both. So the events are numbered in the order in which
    readers see them, and what a transaction has read is true until its end. Readers never wait:
    each reads what was there when it began.

    Parameters
    ----------
    url : str or Path
        ``postgresql://user@host/name``, or the path of a file, also as ``sqlite:///path``.

    Attributes
    ----------
    path : Path or None
        The file of an SQLite data base.
    name : str
        For messages; without the password.

    Raises
    ------
    InvalidValueError
        If the URL is neither.
    """

    def __init__(self, url: str | Path) -> None:
        self.path: Path | None = None
        self._turn: threading.Lock | nullcontext[None] = nullcontext()
        text_url = str(url)
        if isinstance(url, Path) or "://" not in text_url or text_url.startswith(_SQLITE_PREFIX):
            self.path = Path(text_url.removeprefix(_SQLITE_PREFIX)).absolute()
            self.name = str(self.path)
            # Threads that wait in SQLite ask again every 0.1 s; here they are woken.
            self._turn = threading.Lock()
            self.engine = _sqlite_engine(self.path)
        else:
            parsed = _postgresql_url(text_url)
            given = parsed.set(drivername="postgresql")
            self.name = given.render_as_string(hide_password=True)
            self.engine = _postgresql_engine(parsed)
        self._writing = self.engine.execution_options(writes=True)
        # PostgreSQL: one snapshot for all statements, as SQLite has it.
        level = {"isolation_level": "REPEATABLE READ"} if self.path is None else {}
        self._reading = self.engine.execution_options(**level)

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Open a transaction that reads the data base as it is now."""
        with self.translated(), self._reading.begin() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Open a transaction that no other writer disturbs; it is kept whole or not at all."""
        with self._turn, self.translated(), self._writing.begin() as connection:
            if self.path is None:
                connection.execute(text(f"SELECT pg_advisory_xact_lock({_WRITERS_LOCK})"))
            yield connection

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    @contextmanager
    def translated(self) -> Iterator[None]:
        """Turn errors of the data base into :class:`StoreError`."""
        try:
            yield
        except (SQLAlchemyError, sqlite3.Error) as error:
            raise self._error(error) from error

    def _error(self, error: SQLAlchemyError | sqlite3.Error) -> StoreError:
        if isinstance(error, NoConnectionError):
            return StoreError(StoreFault.BUSY, "all connections are in use", self.name)
        cause: Any = error.orig if isinstance(error, DBAPIError) else error
        fault = _POSTGRESQL_FAULTS.get(str(getattr(cause, "sqlstate", "")))
        if self.path is not None:
            name = str(getattr(cause, "sqlite_errorname", "")).removeprefix("SQLITE_")
            fault = _SQLITE_FAULTS.get(name.partition("_")[0])
        reason = str(cause).strip().partition("\n")[0]
        code, what = fault or (StoreFault.UNAVAILABLE, f"cannot be used ({reason})")
        do = "start the service again: it makes a new store" if code is StoreFault.DAMAGED else None
        if fault is None and self.path is None:
            do = "check that PostgreSQL runs, and the URL"
        return StoreError(code, what, self.name, do)


def _sqlite_engine(path: Path) -> Engine:
    """Return connections to a file that exists."""

    def connect() -> sqlite3.Connection:
        # Without mode=rw a store that was removed would be made anew, without its tables.
        connection = sqlite3.connect(
            f"file:{quote(str(path))}?mode=rw",
            uri=True,
            timeout=_BUSY_S,
            isolation_level=None,
            check_same_thread=False,
        )
        # In WAL mode FULL is what brings a confirmed job through a power cut.
        for pragma in ("journal_mode = WAL", "synchronous = FULL"):
            connection.execute(f"PRAGMA {pragma}")
        return connection

    engine = create_engine(
        "sqlite://", creator=connect, poolclass=QueuePool, pool_size=8, max_overflow=24
    )

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    @event.listens_for(engine, "connect")
    def connected(_: Any, record: Any) -> None:
        record.info["file"] = _file_number(path)

    @event.listens_for(engine, "checkout")
    def checked_out(_: Any, record: Any, __: Any) -> None:
        # A store that was moved aside must not be written to any more.
        if record.info["file"] != _file_number(path):
            raise DisconnectionError("another file is in the place of the store")

    return engine


def _file_number(path: Path) -> int:
    try:
        return path.stat().st_ino
    except OSError:
        return -1


def _postgresql_url(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise InvalidValueError("is not a URL of a data base", "store") from error
    if parsed.get_backend_name() not in {"postgresql", "postgres"}:
        raise InvalidValueError(
            f"the store cannot be a data base of the kind {parsed.get_backend_name()!r}",
            parsed.render_as_string(hide_password=True),
            "give postgresql://user@host/name or the path of a file",
        )
    return parsed.set(drivername="postgresql+psycopg")


def _postgresql_engine(url: URL) -> Engine:
    # A writer that is stopped in its transaction loses it, and does not stop all others.
    limits = {
        "lock_timeout": f"{_BUSY_S:g}s",
        "idle_in_transaction_session_timeout": f"{_BUSY_S:g}s",
    }
    options = " ".join(f"-c {name}={value}" for name, value in limits.items())
    given = str(url.query.get("options", ""))
    return create_engine(
        url.update_query_dict({"options": f"{given} {options}".strip()}),
        pool_size=8,
        max_overflow=24,
        pool_pre_ping=True,
        connect_args={"connect_timeout": 10},
    )
