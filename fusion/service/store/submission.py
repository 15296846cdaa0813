"""A request becomes a job of the queue."""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection, Row, select

from fusion.service.jobs import JobRequest, JobState
from fusion.service.store.endings import dependency_error
from fusion.service.store.errors import StoreError, StoreFault, UnknownJobError
from fusion.service.store.rows import add_event, next_number, stored
from fusion.service.store.schema import DEPENDENCY, JOB
from spcola.errors import InvalidValueError

PRIORITY_LIMIT = 100


def add_job(connection: Connection, request: JobRequest, now: float) -> int:
    """Add a job and return its number; that of the first one with the same idempotency key."""
    values = _values(request)
    if request.key:
        mine = (JOB.c.owner == request.user) & (JOB.c.key == request.key)
        first = connection.execute(select(JOB).where(mine)).first()
        if first is not None:
            return _same_request(first, values)
    before = _jobs_before(connection, request.after)
    number = next_number(connection, JOB.c.number)
    state = {"state": JobState.WAITING.value, "submitted": now}
    failed = next((row for row in before if row.state in _LOST), None)
    if failed is not None:
        error = stored(asdict(dependency_error(failed.id, JobState(failed.state))))
        state |= {"state": JobState.FAILED.value, "ended": now, "error": error}
    values["waits"] = sum(row.state != JobState.FINISHED.value for row in before)
    identity = f"{number:08d}-{secrets.token_hex(4)}"
    connection.execute(JOB.insert().values(number=number, id=identity, **values, **state))
    if before:
        pairs = [{"job": number, "after": row.number} for row in before]
        connection.execute(DEPENDENCY.insert(), pairs)
    row = connection.execute(select(JOB).where(JOB.c.number == number)).one()
    content = {"state": row.state, "tries": 0}
    if row.error:
        content["error"] = json.loads(row.error)
    add_event(connection, row, "state", now, content)
    return number


_LOST = {JobState.FAILED.value, JobState.CANCELLED.value}


def _values(request: JobRequest) -> dict[str, Any]:
    """Return the columns of a request."""
    if not -PRIORITY_LIMIT <= request.priority <= PRIORITY_LIMIT:
        raise InvalidValueError(f"{request.priority} is not between -100 and 100", "priority")
    if not (request.workspace and request.user):
        raise InvalidValueError("a job needs a workspace and a user", "job")
    return {
        "kind": request.kind.value,
        "workspace": request.workspace,
        "solution": str(request.parameters.get("solution") or ""),
        "owner": request.user,
        "parameters": stored(request.parameters),
        "priority": request.priority,
        "after": stored(list(dict.fromkeys(request.after))),
        "key": request.key,
    }


def _same_request(first: Row[Any], values: dict[str, Any]) -> int:
    if any(getattr(first, name) != value for name, value in values.items()):
        raise StoreError(
            StoreFault.KEY_REUSED,
            "was given with another request before",
            f"idempotency key {first.key[:60]!r}",
            "give each request a key of its own",
        )
    return int(first.number)


def _jobs_before(connection: Connection, identities: Sequence[str]) -> list[Row[Any]]:
    """Return the rows of the jobs that have to be finished before; raises `UnknownJobError`."""
    wanted = list(dict.fromkeys(identities))
    found = {row.id: row for row in connection.execute(select(JOB).where(JOB.c.id.in_(wanted)))}
    missing = next((name for name in wanted if name not in found), None)
    if missing is not None:
        raise UnknownJobError(missing)
    return [found[name] for name in wanted]
