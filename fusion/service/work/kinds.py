"""What a worker does for each kind of job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

from fusion.inspection.forecasts import forecast_json, stage_forecasts
from fusion.pipeline import Pipeline, StageRun
from fusion.runtime import Executor
from fusion.service.commands.json_options import options_of, wrong_usage
from fusion.service.commands.site import Site
from fusion.service.commands.stages import (
    accepting,
    apply_scale_of,
    check_usable,
    pipeline_of,
)
from fusion.service.commands.table import COMMANDS, Command
from fusion.service.jobs import Job, JobKind, JobRequest
from fusion.service.work.begin import begin_workspace
from fusion.service.work.parameters import (
    ApplyParameters,
    InitParameters,
    RunParameters,
    parameters_of,
)
from fusion.service.work.places import Desk, Places
from fusion.service.work.report import JobReport
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings

UPLOADED = frozenset({JobKind.INIT, *(kind for kind, one in COMMANDS.items() if one.reads_files)})
"""Kinds that read files of users: with limits of memory and time."""


@dataclass(frozen=True)
class Assignment:
    """A job, and what a worker does it with."""

    job: Job
    places: Places
    executor: Executor
    report: JobReport

    @property
    def request(self) -> JobRequest:
        """What the job is asked to do."""
        return self.job.request

    def site(self, solution: str = "", desk: Desk | None = None) -> Site:
        """Return where and with what the command of the job works."""
        root = self.places.workspace(self.request.workspace)
        site = Site(root, self.executor, self.report, solution, job=self.job.id)
        if desk is None:
            return site
        return replace(site, folders=(desk.read,), lasting=desk.lasting)


def perform_job(assignment: Assignment) -> dict[str, Any]:
    """Do a job; return its result, as ``--json`` of the command has it.

    Raises
    ------
    SpcolaError
    """
    kind = assignment.request.kind
    given = parameters_of(kind, assignment.request.parameters)
    if kind in COMMANDS:
        return _by_command(assignment, COMMANDS[kind], given)
    return _KINDS[kind](assignment, given)


def _by_command(assignment: Assignment, command: Command, given: BaseModel) -> dict[str, Any]:
    """Do what a command does with the same options; its lines go to the log."""
    request = assignment.request
    places, job = assignment.places, assignment.job.id
    with places.desk(request.workspace, job, together=command.together) as desk:
        options = options_of(command.options, given, desk.path_of)
        for one in getattr(given, "companions", ()):
            desk.path_of(one, None)
        site = assignment.site(getattr(given, "solution", ""), desk)
        done = wrong_usage(lambda: command.perform(site, options))()
        for line in done.lines:
            assignment.report.result_line(desk.named(line))
        return dict(desk.named_in(done.content))


def _pipeline(assignment: Assignment, given: RunParameters | ApplyParameters) -> Pipeline:
    """Return the stages of a workspace, with the settings of a job."""
    site = assignment.site(given.solution)
    settings = accepting(_settings(site.open(), given), given.accept)
    if isinstance(given, RunParameters):
        return pipeline_of(site, settings, only=given.only, within=given.within)
    return pipeline_of(site, settings)


def _run(assignment: Assignment, given: RunParameters) -> dict[str, Any]:
    """Run stages, as ``spcola run`` or the commands of the stages do."""
    pipeline = _pipeline(assignment, given)
    if given.stages:
        runs = [pipeline.run_stage(stage, force=given.force) for stage in given.stages]
    else:
        runs = pipeline.run(force=given.force)
    for run in runs:
        assignment.report.result_line(_line(run))
    result = {
        "workspace": assignment.request.workspace,
        "stages": [run.as_json() for run in runs],
    }
    check_usable(pipeline, runs, result)
    return result


def _scale_apply(assignment: Assignment, given: ApplyParameters) -> dict[str, Any]:
    """Make a scaled solution, as ``spcola scale --apply`` does."""
    pipeline = _pipeline(assignment, given)
    # A worker that was lost may have made it, and not have recorded that.
    ran, applied = apply_scale_of(pipeline, given.name, force=given.force, job=assignment.job.id)
    for line in (_line(ran), *applied.lines()):
        assignment.report.result_line(line)
    return {**ran.as_json(), "applied": applied.as_dict()}


def _settings(workspace: Workspace, given: RunParameters | ApplyParameters) -> Settings:
    """Return the settings of a workspace with those of a job."""
    return workspace.settings().with_tables(given.settings, "settings of the job")


def _line(run: StageRun) -> str:
    why = f": {run.reason}" if run.reason else ""
    return f"{run.stage}: {run.state}{why}"


def _init(assignment: Assignment, given: InitParameters) -> dict[str, Any]:
    """Make a workspace, or add SPC files to one."""
    places, name = assignment.places, assignment.request.workspace
    return begin_workspace(
        places.workspace(name),
        given,
        shape=places.one_upload(name, given.shape),
        files=places.uploads(name, given.uploads),
        executor=assignment.executor,
        progress=assignment.report,
    )


def _forecast(assignment: Assignment, given: RunParameters) -> dict[str, Any]:
    """Return what each stage will take, as ``spcola run --forecast`` does."""
    workspace = assignment.site(given.solution).open()
    settings = accepting(_settings(workspace, given), given.accept)
    found = stage_forecasts(workspace, settings, workers=assignment.executor.workers)
    details = dict(found["mapolas"].details)
    if given.stages:
        found = {name: found[name] for name in found if name in given.stages}
    return {
        "workspace": assignment.request.workspace,
        "forecast": forecast_json(found),
        "mapolas_forecast": details,
    }


_KINDS: Mapping[JobKind, Callable[[Assignment, Any], dict[str, Any]]] = {
    JobKind.RUN: _run,
    JobKind.SCALE_APPLY: _scale_apply,
    JobKind.INIT: _init,
    JobKind.FORECAST: _forecast,
}
