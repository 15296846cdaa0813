"""Commands of stages with ``--server``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import typer

from fusion.cli.output import run_lines
from fusion.cli.remote_jobs import Given, Printed, Remote, done, log_lines
from fusion.cli.stages import with_options
from fusion.client import Session
from fusion.service.jobs import Job, JobKind
from spcola.errors import RejectedResultError

if TYPE_CHECKING:
    from fusion.pipeline import StageRun

RUN_OPTIONS = frozenset({"solution", "force", "accept", "only", "within"})


def stages_remotely(*names: str, settings: Mapping[str, str] | None = None) -> Remote:
    """Return the command of stages, of whose options some are `settings` of the first one."""
    keys = settings or {}

    def does(session: Session, workspace: str, given: Given) -> Printed:
        changed = {key: given[name] for name, key in keys.items() if given[name] is not None}
        _check_settings(names[0] if names else "", changed, given)
        job = session.submit(
            workspace,
            names,
            settings={names[0]: changed} if changed else {},
            solution=given["solution"],
            only=given["only"] or [],
            within=given["within"],
            accept=given["accept"] or [],
            force=given["force"],
        )
        ended = done(session, job, given, check=False)
        return _ran(session, ended, alone=len(names) == 1)

    return Remote(does, RUN_OPTIONS | keys.keys())


def _check_settings(table: str, changed: Given, given: Given) -> None:
    """Refuse options that no settings have as wrong usage, before anything is sent."""
    from fusion.workspace.settings import Settings

    with_options(Settings(), table, changed, given["accept"] or ())


def run(session: Session, workspace: str, given: Given) -> Printed:
    """Run all stages that are not up to date, or with ``--forecast`` none."""
    if given["only"]:
        raise typer.BadParameter(
            "names items of one stage: give it that command", param_hint="--only"
        )
    if given["forecast"]:
        return _forecast(session, workspace, given)
    return _ALL.does(session, workspace, given)


def scale(session: Session, workspace: str, given: Given) -> Printed:
    """Do the stage, or with ``--apply`` make a scaled solution."""
    if given["name"] and not given["apply"]:
        raise typer.BadParameter("is given without --apply", param_hint="--as")
    if not given["apply"]:
        return _SCALE.does(session, workspace, given)
    method = given["method"]
    _check_settings("scale", {"method": method}, given)
    parameters = {
        "name": given["name"],
        "settings": {"scale": {"method": method}} if method else {},
        "solution": given["solution"],
        "accept": given["accept"] or [],
        "force": given["force"],
    }
    job = done(session, session.submit_job(workspace, JobKind.SCALE_APPLY, parameters), given)
    # The stage with all its values; what came of it is in the log.
    ran = run_lines(_stage_run(job.result))
    return Printed(job.result, [*ran, *log_lines(session, job, "result")[1:]])


def _forecast(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection.forecasts import forecast_lines

    found = session.forecast(workspace, solution=given["solution"], progress=not given["as_json"])
    content = {"workspace": workspace, "forecast": found}
    return Printed(content, list(forecast_lines(found)))


def _ran(session: Session, job: Job, *, alone: bool) -> Printed:
    """Return what a command of stages prints, also of a result that may not be used."""
    error = None
    try:
        session.wait(job, progress=False)
    except RejectedResultError as rejected:
        if not job.result:
            raise
        error = rejected
    found = job.result["stages"]
    lines = [line for one in found for line in run_lines(_stage_run(one))]
    whole = {"workspace": job.request.workspace, "stages": found}
    return Printed(found[0] if alone else whole, lines, error)


def _stage_run(content: Mapping[str, Any]) -> StageRun:
    """Return the run of a stage of its JSON."""
    from fusion.pipeline import StageRun

    names = ("stage", "state", "seconds", "summary")
    values = {name: content[name] for name in names}
    return StageRun(**values, reason=content.get("reason", ""))


_ALL = stages_remotely()
_SCALE = stages_remotely("scale", settings={"method": "method"})
SCALE_OPTIONS = _SCALE.takes - {"only", "within"} | {"apply", "name"}
"""What ``spcola scale`` takes on a server."""
