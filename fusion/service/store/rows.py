"""Rows of the store as values, and back."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, Row, func, select

from fusion.runtime import json_value
from fusion.service.jobs import Event, Job, JobError, JobKind, JobProgress, JobRequest, JobState
from fusion.service.store.errors import UnknownJobError
from fusion.service.store.schema import EVENT, JOB
from spcola.errors import InvalidValueError


def stored(content: Any, *, sort: bool = True) -> str:
    """Return `content` as JSON without NaN; its keys sorted, so that equal content is equal text.

    Raises
    ------
    InvalidValueError
        If it is no JSON.
    """
    try:
        text = json.dumps(json_value(content), sort_keys=sort, separators=(",", ":"))
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidValueError(f"cannot be written as JSON ({error})", "content") from error
    return text


def time_of(value: float | None) -> float:
    """Return a time of the store; NaN if it is not set."""
    return math.nan if value is None else value


def job_of(row: Row[Any]) -> Job:
    """Return the job of a row."""
    request = JobRequest(
        JobKind(row.kind),
        row.workspace,
        row.owner,
        json.loads(row.parameters),
        row.priority,
        tuple(json.loads(row.after)),
        row.key,
    )
    return Job(
        id=row.id,
        request=request,
        state=JobState(row.state),
        tries=row.tries,
        submitted=row.submitted,
        begun=time_of(row.begun),
        ended=time_of(row.ended),
        progress=progress_of(row.progress),
        result=json.loads(row.result),
        error=JobError(**json.loads(row.error)) if row.error else None,
        cancelling=row.cancelling,
    )


def progress_of(content: str) -> JobProgress:
    """Return the progress of a row; a time that is not known is NaN."""
    found = json.loads(content)
    if found.get("remaining_s") is None:
        found["remaining_s"] = math.nan
    return JobProgress(**found)


def row_of(connection: Connection, identity: str) -> Row[Any]:
    """Return the row of a job.

    Raises
    ------
    UnknownJobError
        If there is none.
    """
    row = connection.execute(select(JOB).where(JOB.c.id == identity)).first()
    if row is None:
        raise UnknownJobError(identity)
    return row


def job_number(identity: str) -> int:
    """Return the place of a job in the order of submission; raises `UnknownJobError`."""
    number = identity.partition("-")[0]
    if not (number.isascii() and number.isdigit() and len(number) <= 18):
        raise UnknownJobError(identity)
    return int(number)


def next_number(connection: Connection, column: Any) -> int:
    """Return the number after the largest; writers come one after the other."""
    return 1 + int(connection.execute(select(func.max(column))).scalar() or 0)


def add_event(
    connection: Connection, row: Any, kind: str, now: float, content: Mapping[str, Any]
) -> None:
    """Record what happened to a job.

    Numbers begin at the time in milliseconds: so they grow even when an older backup has been
    restored, and a reader that goes on after the last number it saw misses nothing.
    """
    number = max(next_number(connection, EVENT.c.number), int(now * 1000.0))
    values = {"number": number, "time": now, "kind": kind, "content": stored(content)}
    about = {"job": row.number, "job_id": row.id, "workspace": row.workspace}
    connection.execute(EVENT.insert().values(**values, **about))


def event_of(row: Row[Any]) -> Event:
    """Return the event of a row."""
    content = json.loads(row.content)
    return Event(row.number, row.job_id, row.workspace, row.time, row.kind, content)
