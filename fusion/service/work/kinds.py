"""What a worker does for each kind of job."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fusion.inspection.forecasts import forecast_json, stage_forecasts
from fusion.pipeline import Pipeline, StageRun, Subset
from fusion.runtime import Executor
from fusion.service.jobs import JobKind, JobRequest
from fusion.service.work.begin import begin_workspace
from fusion.service.work.parameters import (
    ImagesParameters,
    ImportParameters,
    InitParameters,
    RunParameters,
    parameters_of,
)
from fusion.service.work.places import Places
from fusion.service.work.report import JobReport
from fusion.stages import import_scans, load_stages
from fusion.stages.images import ImportOptions, Recipe, StateChoice, StateKind, Turn, import_images
from fusion.stages.ingest import LidarFile
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.errors import InvalidValueError, RejectedResultError

UPLOADED = frozenset({JobKind.IMPORT, JobKind.IMAGES, JobKind.INIT})
"""Kinds that read files of users: with limits of memory and time."""


@dataclass(frozen=True)
class Assignment:
    """A job, and what a worker does it with."""

    request: JobRequest
    places: Places
    executor: Executor
    report: JobReport

    def open(self, solution: str = "") -> Workspace:
        """Open the workspace of the job."""
        return Workspace.open(self.places.workspace(self.request.workspace), solution)


def perform_job(assignment: Assignment) -> dict[str, Any]:
    """Do a job; return its result, as ``--json`` of the command has it.

    Raises
    ------
    SpcolaError
    """
    kind = assignment.request.kind
    given = parameters_of(kind, assignment.request.parameters)
    return _KINDS[kind](assignment, given)


def _run(assignment: Assignment, given: RunParameters) -> dict[str, Any]:
    """Run stages, as ``spcola run`` or the commands of the stages do."""
    workspace = assignment.open(given.solution)
    pipeline = Pipeline(
        workspace,
        _settings(workspace, given),
        load_stages(),
        assignment.executor,
        assignment.report,
        subset=Subset.of(given.only, given.within),
    )
    if given.only and len(given.stages) != 1:
        raise InvalidValueError("names items of one stage: name it in stages", "run: only")
    if given.stages:
        runs = [pipeline.run_stage(stage, force=given.force) for stage in given.stages]
    else:
        runs = pipeline.run(force=given.force)
    for run in runs:
        assignment.report.note(_line(run))
    for run in runs:
        if run.obstacle:
            raise RejectedResultError(f"the result of {run.stage} is {run.obstacle}")
    return {
        "workspace": assignment.request.workspace,
        "stages": [run.as_json() for run in runs],
    }


def _settings(workspace: Workspace, given: RunParameters) -> Settings:
    """Return the settings of a workspace with those of a job."""
    settings = workspace.settings().with_tables(given.settings, "settings of the job")
    if not given.accept:
        return settings
    return settings.with_table("accept", codes=[*settings.accept.codes, *given.accept])


def _line(run: StageRun) -> str:
    why = f": {run.reason}" if run.reason else ""
    return f"{run.stage}: {run.state}{why}"


def _import(assignment: Assignment, given: ImportParameters) -> dict[str, Any]:
    """Read uploaded lidar files, as ``spcola import`` does."""
    if given.name and len(given.uploads) > 1:
        raise InvalidValueError("names one file only", "import: name")
    files = assignment.places.uploads(assignment.request.workspace, given.uploads)
    form = (given.format, given.columns, given.unit, given.gps_time)
    done = import_scans(
        assignment.open(),
        [LidarFile(path, given.name, *form) for path in files],
        executor=assignment.executor,
        progress=assignment.report,
    )
    return {"scans": [one.as_dict() for one in done]}


def _images(assignment: Assignment, given: ImagesParameters) -> dict[str, Any]:
    """Bring uploaded images in, as ``spcola images`` does."""
    places, name = assignment.places, assignment.request.workspace
    if given.states == "poses" and (given.poses is None or given.camera is None):
        raise InvalidValueError("need a table of poses and a camera", "images: states")
    files = places.uploads(name, given.uploads)
    poses, camera, times, pck, dark, flat = (
        places.one_upload(name, upload)
        for upload in (given.poses, given.camera, given.times, given.pck, given.dark, given.flat)
    )
    states = StateChoice(
        StateKind(given.states), poses, camera, times, columns=given.columns, pck=pck
    )
    recipe = Recipe(dark, flat, given.dark_scale, given.bits, _turn(given.orientation))
    workspace = assignment.open(given.solution)
    done = import_images(
        workspace,
        files,
        ImportOptions(recipe, states, given.letter, tuple(given.filters), given.size),
        executor=assignment.executor,
        progress=assignment.report,
    )
    return {
        "workspace": name,
        "solution": workspace.solution,
        "new": [record.as_json() for record in done.new],
        "known": [record.name for record in done.known],
        "filtered": done.filtered,
        "remarks": list(done.remarks),
        "doubts": [one.as_json() for one in done.doubts],
    }


def _turn(name: str) -> Turn:
    try:
        return Turn(name)
    except ValueError as error:
        raise InvalidValueError(
            f"{name!r} is none of {', '.join(Turn)}", "images: orientation"
        ) from error


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
    workspace = assignment.open(given.solution)
    found = stage_forecasts(
        workspace, _settings(workspace, given), workers=assignment.executor.workers
    )
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
    JobKind.IMPORT: _import,
    JobKind.IMAGES: _images,
    JobKind.INIT: _init,
    JobKind.FORECAST: _forecast,
}
