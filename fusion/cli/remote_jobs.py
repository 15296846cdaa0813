"""What a command with ``--server`` is: the calls that it does, and how it waits for its job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import typer

from fusion.client import Session
from fusion.service.jobs import Job
from spcola.errors import SpcolaError

Given = Mapping[str, Any]


class Printed(NamedTuple):
    """What a command prints: the object of ``--json``, lines, and the error with which it ends."""

    content: Mapping[str, Any]
    lines: list[str]
    error: SpcolaError | None = None


@dataclass(frozen=True)
class Remote:
    """What a command does on a server: calls, and the options that they take.

    Parameters
    ----------
    does : callable
        Takes the session, the name of the workspace, and all options.
    takes : frozenset of str
        Names of options; others are refused if they are given.
    files : bool
        Whether it works on a file in the workspace too, named ``WS/FILE``.
    """

    does: Callable[[Session, str, Given], Printed]
    takes: frozenset[str] = field(default_factory=frozenset)
    files: bool = False


def done(session: Session, job: Job, given: Given, *, check: bool = True) -> Job:
    """Wait for a job, and print its warnings; Ctrl-C leaves it running.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C; it says how to come back.
    SpcolaError
        If it failed, unless it need not be checked.
    """
    try:
        ended = session.wait(job, progress=not given["as_json"], check=False)
        for line in () if given["as_json"] else log_lines(session, job, "warning"):
            typer.echo(line, err=True)
        return session.wait(ended, progress=False) if check else ended
    except KeyboardInterrupt as error:
        place = f"spcola --server {session.place.name} job"
        words = f"{job.request.workspace} {job.id}"
        raise KeyboardInterrupt(
            f"the job goes on; come back: {place} wait {words}; stop it: {place} cancel {words}"
        ) from error


def log_lines(session: Session, job: Job, level: str) -> list[str]:
    """Return the lines of one level of a job's log; each warning once."""
    found = [line["text"] for line in session.log(job) if line.get("level") == level]
    return list(dict.fromkeys(found)) if level == "warning" else found
