"""After a store was lost: what the records of the workspaces show had been done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from fusion.pipeline.catalog import read_records
from fusion.pipeline.solutions import solutions_of
from fusion.service.jobs import JobKind, JobRequest
from fusion.service.store.records import AuditEntry
from fusion.service.store.store import Store
from fusion.workspace import Workspace
from spcola.errors import SpcolaError

__all__ = ["record_recovered_runs"]

RECOVERED_USER = "recovered"
"""In whose name the runs are listed: the records do not contain who submitted them."""


def record_recovered_runs(store: Store, workspaces: Mapping[str, Path]) -> list[str]:
    """Record a finished run for each solution of the workspaces that has finished stages.

    For a new store in the place of a damaged one (`Store.notes`). Each run has the summaries of
    the stages as its result, and ended with the last of them. What waited, tokens and the audit
    log are in backups only. A second time adds no run.

    Parameters
    ----------
    store : Store
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
                    parameters = {"stages": list(result), "solution": solution.name}
                    request = JobRequest(
                        JobKind.RUN,
                        name,
                        RECOVERED_USER,
                        parameters,
                        key=f"{name}/{solution.name}",
                    )
                    store.add_finished(request, result, ended)
                    finished = ", ".join(result)
                    lines.append(f"{name}, solution {solution.name}: {finished} had finished")
        except (SpcolaError, ValueError) as error:  # ValueError: a time that is none
            lines.append(f"{name}: is not recovered ({error})")
    for line in lines:
        store.audit.add(AuditEntry("spcola", "run-recovered", details={"text": line}))
    return lines


def _seconds(time: str) -> float:
    """Return seconds since 1970 of a record's UTC time, ISO 8601."""
    moment = datetime.fromisoformat(time)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
