"""The tables of the store, and the steps that bring those of an earlier version up to date."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Connection,
    Double,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    inspect,
    select,
    text,
)

VERSION = 2


def _without_renewals(connection: Connection) -> None:
    """Version 1 counted renewals of leases; lost workers are judged by what they finished."""
    connection.execute(text("ALTER TABLE job DROP COLUMN renewals"))


UPGRADES: Mapping[int, Callable[[Connection], None]] = {1: _without_renewals}
"""From each earlier version the step to the next one."""

TABLES = MetaData()


def _text(name: str, default: str = "") -> Column[str]:
    return Column(name, Text, nullable=False, default=default)


def _count(name: str, default: int = 0) -> Column[int]:
    return Column(name, BigInteger, nullable=False, default=default)


SETTING = Table("setting", TABLES, Column("name", Text, primary_key=True), _text("value"))

# `number` is the order of submission; an id adds random letters to it, so that after a restored
# backup no new job has the id of a forgotten one. Times are seconds since 1970, NULL before.
JOB = Table(
    "job",
    TABLES,
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("id", Text, nullable=False, unique=True),
    _text("kind"),
    _text("workspace"),
    _text("solution"),
    _text("owner"),
    _text("parameters"),
    Column("priority", Integer, nullable=False, default=0),
    _text("after"),
    _text("key"),
    _text("state"),
    _count("tries"),
    Column("submitted", Double, nullable=False),
    Column("begun", Double),
    Column("ended", Double),
    _text("progress", "{}"),
    _text("result", "{}"),
    _text("error"),
    Column("cancelling", Boolean, nullable=False, default=False),
    _count("waits"),  # jobs of `after` that are not finished
    Column("since", Double, nullable=False, default=0.0),  # it was given back,
    Column("until", Double, nullable=False, default=0.0),  # to wait until then
    _text("worker"),
    Column("lease_s", Double, nullable=False, default=0.0),
    _count("beat"),  # grows with each claim and renewal, never back
    _count("losses"),  # workers lost in sequence that had finished no item
    _count("notes"),
    Index("job_state", "state", "workspace", "solution"),
    Index("job_workspace", "workspace", "number"),
    Index("job_owner", "owner", "number"),
    Index(
        "job_key",
        "owner",
        "key",
        unique=True,
        sqlite_where=text("key <> ''"),
        postgresql_where=text("key <> ''"),
    ),
)

DEPENDENCY = Table(
    "dependency",
    TABLES,
    Column("job", BigInteger, primary_key=True, autoincrement=False),
    Column("after", BigInteger, primary_key=True, autoincrement=False),
    Index("dependency_after", "after"),
)

# The number of the turn in which the last job of a user began.
TURN = Table("turn", TABLES, Column("owner", Text, primary_key=True), _count("turn"))

EVENT = Table(
    "event",
    TABLES,
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("job", BigInteger, nullable=False),
    Column("job_id", Text, nullable=False),
    _text("workspace"),
    Column("time", Double, nullable=False),
    _text("kind"),
    _text("content", "{}"),
    Index("event_job", "job", "number"),
    Index("event_workspace", "workspace", "number"),
)

TOKEN = Table(
    "token",
    TABLES,
    Column("id", Text, primary_key=True),
    Column("digest", Text, nullable=False, unique=True),
    _text("owner"),
    _text("name"),
    _text("scopes", "{}"),
    Column("created", Double, nullable=False),
    Column("expires", Double),
    Column("revoked", Double),
    Column("last_used", Double),
)

AUDIT = Table(
    "audit",
    TABLES,
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("time", Double, nullable=False),
    _text("owner"),
    _text("action"),
    _text("workspace"),
    _text("target"),
    _text("outcome"),
    _text("address"),
    _text("details", "{}"),
    Index("audit_workspace", "workspace", "number"),
)

UPLOAD = Table(
    "upload",
    TABLES,
    Column("id", Text, primary_key=True),
    _text("workspace"),
    _text("owner"),
    _text("name"),
    _text("kind"),
    _count("size"),
    _text("sha256"),
    _count("offset"),
    _text("state"),
    Column("created", Double, nullable=False),
    Column("changed", Double, nullable=False),
    Index("upload_workspace", "workspace", "created"),
)


def stored_version(connection: Connection) -> int:
    """Return the version of the tables; 0 if there are none."""
    if not inspect(connection).has_table(SETTING.name):
        return 0
    query = select(SETTING.c.value).where(SETTING.c.name == "version")
    return int(connection.execute(query).scalar() or 0)


def make_tables(connection: Connection) -> None:
    """Make the tables of this version in an empty data base."""
    TABLES.create_all(connection)
    connection.execute(SETTING.insert().values(name="version", value=str(VERSION)))


def upgrade_tables(connection: Connection, version: int) -> None:
    """Bring the tables of an earlier version up to this one, in the caller's transaction."""
    for step in range(version, VERSION):
        UPGRADES[step](connection)
    new = SETTING.update().where(SETTING.c.name == "version").values(value=str(VERSION))
    connection.execute(new)
