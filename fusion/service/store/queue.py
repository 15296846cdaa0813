"""The queue of jobs on SQL."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection, Row, func, select

from fusion.service.jobs import Event, Job, JobError, JobProgress, JobRequest, JobState
from fusion.service.store.claims import LeaseWatch, next_job, take_turn
from fusion.service.store.database import Database
from fusion.service.store.endings import end_job, lose_worker, set_state, wait_again
from fusion.service.store.errors import LeaseLostError
from fusion.service.store.rows import (
    add_event,
    event_of,
    job_number,
    job_of,
    progress_of,
    row_of,
    stored,
    time_of,
)
from fusion.service.store.schema import EVENT, JOB
from fusion.service.store.submission import add_job

MOST_NOTES = 10_000
"""Lines of the log of one job."""
_LONGEST_NOTE = 4000


class SqlQueue:
    """Implements :class:`fusion.service.jobs.JobQueue`; each method is one transaction.

    Times are of the clock of the host that writes. No lease depends on them (`LeaseWatch`), and
    the turns of users are counted.

    Parameters
    ----------
    database : Database
    clock : callable
        Seconds since 1970.
    monotonic : callable
        Seconds of a clock that is never set.
    """

    def __init__(
        self,
        database: Database,
        *,
        clock: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._database = database
        self._clock = clock
        self._leases = LeaseWatch(monotonic)

    def submit(self, request: JobRequest) -> Job:
        """Add a job; a request with a known idempotency key gives the job of its first time.

        One that comes after a job that failed or was cancelled has failed at once.

        Raises
        ------
        StoreError
            `KEY_REUSED` if the first request with the key was another one.
        UnknownJobError
            If there is no job that it comes after.
        InvalidValueError
            If the priority is out of range, or the parameters are no JSON.
        """
        with self._database.writing() as connection:
            number = add_job(connection, request, self._clock())
            return job_of(connection.execute(select(JOB).where(JOB.c.number == number)).one())

    def add_finished(self, request: JobRequest, result: Mapping[str, Any], ended: float) -> None:
        """Record a job that was finished without this queue; raises as :meth:`submit`."""
        with self._database.writing() as connection:
            number = add_job(connection, request, ended)
            row = connection.execute(select(JOB).where(JOB.c.number == number)).one()
            if row.state == JobState.WAITING.value:
                end_job(
                    connection, row, JobState.FINISHED, ended, result=stored(result, sort=False)
                )

    def job(self, identity: str) -> Job:
        """Return a job; raises `UnknownJobError`."""
        with self._database.reading() as connection:
            return job_of(row_of(connection, identity))

    def jobs(
        self,
        *,
        workspaces: Collection[str] | None = None,
        states: Collection[JobState] | None = None,
        user: str = "",
        before: str = "",
        limit: int = 100,
    ) -> list[Job]:
        """Return jobs, the newest first; `before` is the last one of the page before."""
        query = select(JOB).order_by(JOB.c.number.desc()).limit(limit)
        if workspaces is not None:
            query = query.where(JOB.c.workspace.in_(workspaces))
        if states is not None:
            query = query.where(JOB.c.state.in_([state.value for state in states]))
        if user:
            query = query.where(JOB.c.owner == user)
        if before:
            query = query.where(JOB.c.number < job_number(before))
        with self._database.reading() as connection:
            return [job_of(row) for row in connection.execute(query)]

    def counts(self) -> dict[JobState, int]:
        """Return how many jobs there are in each state."""
        query = select(JOB.c.state, func.count()).group_by(JOB.c.state)
        with self._database.reading() as connection:
            found = {str(row[0]): int(row[1]) for row in connection.execute(query)}
        return {state: found.get(state.value, 0) for state in JobState}

    def oldest(self) -> dict[JobState, float]:
        """Return since when the oldest job waits (as submitted) and runs; NaN if none does."""
        begun = {JobState.WAITING: JOB.c.submitted, JobState.RUNNING: JOB.c.begun}
        with self._database.reading() as connection:
            found = {
                state: connection.execute(
                    select(func.min(time)).where(JOB.c.state == state.value)
                ).scalar()
                for state, time in begun.items()
            }
        return {state: time_of(time) for state, time in found.items()}

    def claim(self, worker: str, lease_s: float) -> Job | None:
        """Take the next job that may begin; None if there is none.

        Jobs whose lease has ended wait again, or fail after `LOSSES` workers in sequence.
        """
        with self._database.writing() as connection:
            now = self._clock()
            for lost in self._leases.ended(connection):
                lose_worker(connection, lost, now)
            row = next_job(connection, now)
            if row is None:
                return None
            take_turn(connection, row.owner)
            begun = {"begun": now, "tries": row.tries + 1, "worker": worker, "lease_s": lease_s}
            beat = {"beat": row.beat + 1, "progress": stored({})}
            set_state(connection, row, JobState.RUNNING, now, **begun, **beat)
            return job_of(row_of(connection, row.id))

    def renew(self, identity: str, worker: str, lease_s: float, progress: JobProgress) -> bool:
        """Renew a lease and record progress; return whether the job is to be cancelled.

        Raises
        ------
        LeaseLostError
            If the job belongs to another worker by now, or has ended.
        """
        with self._database.writing() as connection:
            row = _leased(connection, identity, worker)
            content = stored(asdict(progress))
            beat = {"beat": row.beat + 1, "lease_s": lease_s}
            update = JOB.update().where(JOB.c.number == row.number)
            connection.execute(update.values(progress=content, **beat))
            if progress_of(row.progress) != progress and content != row.progress:
                self._progress_event(connection, row, progress)
            return bool(row.cancelling)

    def _progress_event(self, connection: Connection, row: Row[Any], new: JobProgress) -> None:
        """Record progress; only the newest is kept: a month of them would fill the store."""
        mine = (EVENT.c.job == row.number) & (EVENT.c.kind == "progress")
        older = [number for (number,) in connection.execute(select(EVENT.c.number).where(mine))]
        add_event(connection, row, "progress", self._clock(), asdict(new))
        if older:
            connection.execute(EVENT.delete().where(EVENT.c.number.in_(older)))

    def note(self, identity: str, text: str, content: Mapping[str, Any] | None = None) -> None:
        """Add a line to the job's log; of more than `MOST_NOTES` the further ones are left out."""
        with self._database.writing() as connection:
            row = row_of(connection, identity)
            if row.notes > MOST_NOTES:
                return
            update = JOB.update().where(JOB.c.number == row.number)
            connection.execute(update.values(notes=row.notes + 1))
            line = text[:_LONGEST_NOTE] if row.notes < MOST_NOTES else "further lines are left out"
            add_event(connection, row, "note", self._clock(), {"text": line, **(content or {})})

    def finish(self, identity: str, worker: str, result: Mapping[str, Any]) -> None:
        """Record the result of a job; a second time of the same worker changes nothing."""
        with self._database.writing() as connection:
            row = row_of(connection, identity)
            if (row.state, row.worker) == (JobState.FINISHED.value, worker):
                return
            row = _leased(connection, identity, worker)
            content = stored(result, sort=False)
            end_job(connection, row, JobState.FINISHED, self._clock(), result=content, losses=0)

    def fail(
        self,
        identity: str,
        worker: str,
        error: JobError,
        result: Mapping[str, Any] | None = None,
    ) -> None:
        """Record that a job failed, with a result that may not be used if it has one.

        Those that come after it fail. One that was to be cancelled is cancelled, and keeps the
        error.
        """
        with self._database.writing() as connection:
            row = row_of(connection, identity)
            if JobState(row.state).ended and row.worker == worker:
                return
            row = _leased(connection, identity, worker)
            state = JobState.CANCELLED if row.cancelling else JobState.FAILED
            content = stored(result or {}, sort=False)
            end_job(connection, row, state, self._clock(), error=error, result=content)

    def give_back(self, identity: str, worker: str, *, wait_s: float = 0.0) -> None:
        """Let a job wait again, for a time: a drained worker, a full disk, a lost scheduler.

        One that was to be cancelled is cancelled.
        """
        with self._database.writing() as connection:
            row = _leased(connection, identity, worker)
            wait_again(connection, row, self._clock(), wait_s)

    def lost(self, worker: str) -> None:
        """Let the jobs of a worker wait again whose process is known to have ended.

        As if its lease had ended, but at once.
        """
        with self._database.writing() as connection:
            mine = (JOB.c.worker == worker) & (JOB.c.state == JobState.RUNNING.value)
            for row in list(connection.execute(select(JOB).where(mine))):
                lose_worker(connection, row, self._clock())

    def cancel(self, identity: str) -> Job:
        """Cancel a waiting job at once; ask the worker of a running one to stop."""
        with self._database.writing() as connection:
            row = row_of(connection, identity)
            now = self._clock()
            if row.state == JobState.WAITING.value:
                end_job(connection, row, JobState.CANCELLED, now)
            elif row.state == JobState.RUNNING.value and not row.cancelling:
                set_state(connection, row, JobState.RUNNING, now, cancelling=True)
            return job_of(row_of(connection, identity))

    def events(
        self,
        after: int = 0,
        *,
        job: str = "",
        workspaces: Collection[str] | None = None,
        limit: int = 1000,
    ) -> list[Event]:
        """Return events with larger numbers than `after`, in their order."""
        query = select(EVENT).where(EVENT.c.number > after).order_by(EVENT.c.number).limit(limit)
        if job:
            query = query.where(EVENT.c.job == job_number(job), EVENT.c.job_id == job)
        if workspaces is not None:
            query = query.where(EVENT.c.workspace.in_(workspaces))
        with self._database.reading() as connection:
            return [event_of(row) for row in connection.execute(query)]


def _leased(connection: Connection, identity: str, worker: str) -> Row[Any]:
    """Return the row of a job that belongs to a worker; raises `LeaseLostError`."""
    row = row_of(connection, identity)
    if row.state != JobState.RUNNING.value or row.worker != worker:
        raise LeaseLostError(identity, worker)
    return row
