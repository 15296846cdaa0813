"""After a store was lost: what the records of the workspaces show had been done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import select

from fusion.pipeline.catalog import read_records
from fusion.pipeline.solutions import solutions_of
from fusion.service.jobs import JobKind, JobRequest, JobState
from fusion.service.store.database import Database
from fusion.service.store.endings import end_job
from fusion.service.store.rows import stored
from fusion.service.store.schema import JOB
from fusion.service.store.submission import add_job
from fusion.workspace import Workspace
from spcola.errors import SpcolaError

RECOVERED_USER = "recovered"
"""In whose name the runs are listed: the records do not contain who submitted them."""


def record_recovered_runs(database: Database, workspaces: Mapping[str, Path]) -> list[str]:
    """Record a finished run for each solution of the workspaces that has finished stages.

    It has the summaries of the stages as its result, and ended with the last of them. A second
    time changes nothing.

    Parameters
    ----------
    database : Database
    workspaces : mapping of str to Path
        Folders by the names of the workspaces.

    Returns
    -------
    list of str
        A line for each solution with finished stages, and each workspace that cannot be read.
    """
    lines = []
    for name, root in workspaces.items():
        try:
            workspace = Workspace.open(root)
            for solution in solutions_of(workspace).records:
                stages = read_records(replace(workspace, solution=solution.name))
                if stages:
                    ended = max(_seconds(stage.finished) for stage in stages)
                    result = {stage.stage: stage.summary for stage in stages}
                    _record_run(database, name, solution.name, result, ended)
                    finished = ", ".join(result)
                    lines.append(f"{name}, solution {solution.name}: {finished} had finished")
        except SpcolaError as error:
            lines.append(f"{name}: is not recovered ({error})")
    return lines


def _seconds(time: str) -> float:
    """Return seconds since 1970 of a record's UTC time, ISO 8601."""
    moment = datetime.fromisoformat(time)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _record_run(
    database: Database, name: str, solution: str, result: Mapping[str, Any], ended: float
) -> None:
    parameters = {"stages": list(result), "solution": solution}
    key = f"{name}/{solution}"
    request = JobRequest(JobKind.RUN, name, RECOVERED_USER, parameters, key=key)
    with database.writing() as connection:
        number = add_job(connection, request, ended)
        row = connection.execute(select(JOB).where(JOB.c.number == number)).one()
        if row.state == JobState.WAITING.value:
            end_job(connection, row, JobState.FINISHED, ended, result=stored(result))
