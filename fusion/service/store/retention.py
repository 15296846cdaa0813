"""Old rows are removed: of jobs that have ended, of the audit log, and of uploads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, and_, exists, func, select

from fusion.service.jobs import JobState
from fusion.service.store.database import Database
from fusion.service.store.records import UploadState
from fusion.service.store.schema import AUDIT, DEPENDENCY, EVENT, JOB, UPLOAD

_ENDED = [state.value for state in JobState if state.ended]
# Other writers wait no longer than the removal of so many rows takes.
_ROWS = 500
_LOOKED_FOR = 50_000


class Retention:
    """Removes what is older than an age, in short transactions.

    The newest job, event and entry always stay: numbers go on from theirs, so that none is given
    twice.
    """

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock

    def remove_jobs(self, age_s: float) -> int:
        """Remove jobs that ended so long ago, with their events; return how many.

        Those that a job which has not ended comes after stay, and so do their idempotency keys.
        """
        waiting = JOB.alias("waiting")
        needed = exists().where(
            DEPENDENCY.c.after == JOB.c.number,
            waiting.c.number == DEPENDENCY.c.job,
            waiting.c.state.not_in(_ENDED),
        )
        old = and_(JOB.c.state.in_(_ENDED), JOB.c.ended < self._clock() - age_s, ~needed)

        def remove(connection: Connection, numbers: list[Any]) -> None:
            connection.execute(EVENT.delete().where(EVENT.c.job.in_(numbers), ~_newest(EVENT)))
            connection.execute(DEPENDENCY.delete().where(DEPENDENCY.c.job.in_(numbers)))

        return self._remove(JOB, old & ~_newest(JOB), before=remove)

    def remove_events(self, age_s: float) -> int:
        """Remove events so old of jobs that have ended: their logs; return how many."""
        going_on = select(JOB.c.number).where(JOB.c.state.not_in(_ENDED))
        old = and_(EVENT.c.time < self._clock() - age_s, EVENT.c.job.not_in(going_on))
        return self._remove(EVENT, old & ~_newest(EVENT))

    def remove_entries(self, age_s: float) -> int:
        """Remove entries of the audit log; return how many."""
        old = AUDIT.c.time < self._clock() - age_s
        return self._remove(AUDIT, old & ~_newest(AUDIT))

    def remove_uploads(self, age_s: float) -> int:
        """Remove the records of uploads whose files were removed so long ago."""
        removed = UPLOAD.c.state == UploadState.REMOVED.value
        return self._remove(UPLOAD, removed & (UPLOAD.c.changed < self._clock() - age_s))

    def _remove(
        self,
        table: Table,
        old: ColumnElement[bool],
        before: Callable[[Connection, list[Any]], None] = lambda *_: None,
    ) -> int:
        """Remove rows in portions; `before` removes what belongs to them.

        What is old stays old: it is looked for while others write.
        """
        (key,) = table.primary_key.columns
        count = 0
        while True:
            with self._database.reading() as connection:
                query = select(key).where(old).order_by(key).limit(_LOOKED_FOR)
                found = [row[0] for row in connection.execute(query)]
            for begin in range(0, len(found), _ROWS):
                part = found[begin : begin + _ROWS]
                with self._database.writing() as connection:
                    before(connection, part)
                    connection.execute(table.delete().where(key.in_(part)))
            count += len(found)
            if len(found) < _LOOKED_FOR:
                return count


def _newest(table: Table) -> ColumnElement[bool]:
    """Return the condition of the row with the largest number."""
    copy = table.alias()
    return table.c.number == select(func.max(copy.c.number)).scalar_subquery()
