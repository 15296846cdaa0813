"""The audit log: entries are added, never changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from sqlalchemy import Row, select

from fusion.service.store.database import Database
from fusion.service.store.records import AuditEntry
from fusion.service.store.rows import next_number, stored
from fusion.service.store.schema import AUDIT


class AuditLog:
    """Who did what on the service."""

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock

    def add(self, entry: AuditEntry) -> None:
        """Add an entry; the store gives its number and time."""
        values = {**asdict(entry), "time": self._clock(), "details": stored(entry.details)}
        values["owner"] = values.pop("user")
        with self._database.writing() as connection:
            values["number"] = next_number(connection, AUDIT.c.number)
            connection.execute(AUDIT.insert().values(**values))

    def entries(
        self, *, before: int = 0, workspace: str = "", user: str = "", limit: int = 100
    ) -> list[AuditEntry]:
        """Return entries, the newest first; `before` is the last number of the page before."""
        query = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit)
        if before:
            query = query.where(AUDIT.c.number < before)
        if workspace:
            query = query.where(AUDIT.c.workspace == workspace)
        if user:
            query = query.where(AUDIT.c.owner == user)
        with self._database.reading() as connection:
            return [_entry(row) for row in connection.execute(query)]


def _entry(row: Row[Any]) -> AuditEntry:
    values = dict(row._mapping)
    details = json.loads(values.pop("details"))
    return AuditEntry(values.pop("owner"), details=details, **values)
