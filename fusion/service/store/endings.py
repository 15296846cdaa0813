"""Jobs change their state: they end, and with them those that come after them, or wait again."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection, select

from fusion.service.jobs import JobError, JobState
from fusion.service.store.rows import add_event, progress_of, stored
from fusion.service.store.schema import DEPENDENCY, JOB

LOSSES = 3
"""After so many workers lost in sequence, none of which finished an item, a job fails."""


def set_state(
    connection: Connection,
    row: Any,
    state: JobState,
    now: float,
    *,
    error: JobError | None = None,
    **values: Any,
) -> None:
    """Change the state of a job, and record the event."""
    content: dict[str, Any] = {"state": state.value, "tries": values.get("tries", row.tries)}
    if error is not None:
        content["error"] = asdict(error)
        values["error"] = stored(content["error"])
    update = JOB.update().where(JOB.c.number == row.number)
    connection.execute(update.values(state=state.value, **values))
    add_event(connection, row, "state", now, content)


def end_job(
    connection: Connection,
    row: Any,
    state: JobState,
    now: float,
    *,
    error: JobError | None = None,
    **values: Any,
) -> None:
    """End a job. Those after a finished one may begin; those after any other fail."""
    set_state(connection, row, state, now, error=error, ended=now, cancelling=False, **values)
    ended = [(row, state)]
    while ended:
        before, outcome = ended.pop()
        for dependent in _waiting_for(connection, before.number):
            if outcome is JobState.FINISHED:
                update = JOB.update().where(JOB.c.number == dependent.number)
                connection.execute(update.values(waits=JOB.c.waits - 1))
            else:
                reason = dependency_error(before.id, outcome)
                set_state(connection, dependent, JobState.FAILED, now, error=reason, ended=now)
                ended.append((dependent, JobState.FAILED))


def _waiting_for(connection: Connection, number: int) -> list[Any]:
    """Return the rows of the waiting jobs that come after a job."""
    query = (
        select(JOB)
        .join(DEPENDENCY, DEPENDENCY.c.job == JOB.c.number)
        .where(DEPENDENCY.c.after == number, JOB.c.state == JobState.WAITING.value)
        .order_by(JOB.c.number)
    )
    return list(connection.execute(query))


def dependency_error(identity: str, state: JobState) -> JobError:
    """Return why a job fails that comes after one that was not finished."""
    return JobError("dependency-failed", f"job {identity}, which it comes after, {_ENDED[state]}")


_ENDED = {JobState.FAILED: "failed", JobState.CANCELLED: "was cancelled"}


def wait_again(connection: Connection, row: Any, now: float, wait_s: float = 0.0) -> None:
    """Let a running job wait again; one that is to be cancelled ends."""
    if row.cancelling:
        end_job(connection, row, JobState.CANCELLED, now)
    else:
        set_state(connection, row, JobState.WAITING, now, since=now, until=now + max(wait_s, 0.0))


def _doing(row: Any) -> str:
    """Return what the last worker was doing, as far as it reported that."""
    progress = progress_of(row.progress)
    parts = [part for part in (progress.stage, progress.task) if part]
    counted = f", {progress.done} of {progress.total}" if progress.total else ""
    return f", the last one on {': '.join(parts)}{counted}" if parts else ""


def lose_worker(connection: Connection, row: Any, now: float) -> None:
    """Let the job of a lost worker wait again; it fails if none of several finished an item.

    A worker that kept an item made progress, of which there is an end: the count begins anew.
    """
    losses = 0 if progress_of(row.progress).kept else row.losses + 1
    if losses >= LOSSES and not row.cancelling:
        text = f"{losses} workers in sequence ended and had finished no item{_doing(row)}"
        error = JobError("workers-lost", text)
        end_job(connection, row, JobState.FAILED, now, error=error, losses=losses)
        return
    update = JOB.update().where(JOB.c.number == row.number)
    connection.execute(update.values(losses=losses))
    wait_again(connection, row, now)
