"""Commands with ``--server``: one table from a command to calls of the client."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature, unwrap
from pathlib import Path
from typing import Any

import typer

from fusion.cli import altimetry, folder, images, jobs, solution, stages, states, truth
from fusion.cli.options import with_shared_options
from fusion.cli.output import run_lines, show, value_lines
from fusion.client import Session, VersionWarning, connect
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.commands.json_options import json_of, outputs_of
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import Job, JobKind
from fusion.service.state import WORKSPACE_NAME
from spcola.errors import SpcolaError

Given = Mapping[str, Any]
Printed = tuple[Mapping[str, Any], list[str]]
_RUN = frozenset({"solution", "force", "accept", "only", "within"})
# Of the overview, what `info` does not print.
_FILES = {JobKind.IMPORT: "scan", JobKind.IMAGES: "image"}
_BEYOND = ("name", "bigmaps", "pairs", "released", "verdicts", "findings", "results")


@dataclass(frozen=True)
class Remote:
    """What a command does on a server: calls, and the options that they take.

    Parameters
    ----------
    does : callable
        Takes the session, the name of the workspace, and all options.
    takes : frozenset of str
        Names of options; others are refused if they are given.
    """

    does: Callable[[Session, str, Given], Printed]
    takes: frozenset[str] = field(default_factory=frozenset)


def do_remotely(server: str, command: Callable[..., Any], given: Given) -> None:
    """Do a command on a server.

    Parameters
    ----------
    server : str
        Its address.
    command : callable
        What does it here; its signature has the options with their defaults.
    given : mapping
        The options, by name.

    Raises
    ------
    SpcolaError
        If the command, or an option that was given, has no meaning there.
    """
    remote = REMOTE.get(unwrap(command))
    if remote is None:
        raise SpcolaError("works on local files only", "this command", "leave out --server")
    for name, option in signature(command).parameters.items():
        known = name in remote.takes | {"workspace", "path", "as_json"}
        if not known and given[name] != option.default:
            named = f"--{name.replace('_', '-')}"
            raise SpcolaError("cannot be given to a server", named, "leave it out")
    workspace = str(given["workspace"] if "workspace" in given else given["path"])
    if not re.fullmatch(WORKSPACE_NAME, workspace):
        do = "give the name alone"
        raise SpcolaError("is no name of a workspace on a server", workspace, do)
    with _connected(server) as session:
        content, lines = remote.does(session, workspace, given)
        show(content, lines, as_json=given["as_json"])


def _connected(server: str) -> Session:
    """Return a session; another version of the server is a line on standard error."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", VersionWarning)
        session = connect(server)
    for each in found:
        typer.echo(f"warning: {each.message}", err=True)
    return session


def _done(session: Session, job: Job, given: Given) -> Job:
    """Wait for a job; Ctrl-C leaves it running.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C; it says how to come back.
    """
    try:
        return session.wait(job, progress=not given["as_json"])
    except KeyboardInterrupt as error:
        place = f"spcola --server {session.place.name} job"
        words = f"{job.request.workspace} {job.id}"
        raise KeyboardInterrupt(
            f"the job goes on; come back: {place} wait {words}; stop it: {place} cancel {words}"
        ) from error


def _stages(*names: str, settings: Mapping[str, str] | None = None) -> Remote:
    """Return the command of stages, of whose options some are `settings` of the first one."""
    keys = settings or {}

    def does(session: Session, workspace: str, given: Given) -> Printed:
        changed = {key: given[name] for name, key in keys.items() if given[name] is not None}
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
        return _ran(_done(session, job, given), alone=len(names) == 1)

    return Remote(does, _RUN | keys.keys())


def _run(session: Session, workspace: str, given: Given) -> Printed:
    if given["only"]:
        raise typer.BadParameter(
            "names items of one stage: give it that command", param_hint="--only"
        )
    if given["forecast"]:
        return _forecast(session, workspace, given)
    return _stages_all.does(session, workspace, given)


def _scale(session: Session, workspace: str, given: Given) -> Printed:
    """Do the stage, or with ``--apply`` make a scaled solution."""
    if given["name"] and not given["apply"]:
        raise typer.BadParameter("is given without --apply", param_hint="--as")
    if not given["apply"]:
        return _scale_stage.does(session, workspace, given)
    method = given["method"]
    parameters = {
        "name": given["name"],
        "settings": {"scale": {"method": method}} if method else {},
        "solution": given["solution"],
        "accept": given["accept"] or [],
        "force": given["force"],
    }
    job = _done(session, session.submit_job(workspace, JobKind.SCALE_APPLY, parameters), given)
    return job.result, [line["text"] for line in session.log(job)]


def _forecast(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection.forecasts import forecast_lines

    found = session.forecast(workspace, solution=given["solution"], progress=not given["as_json"])
    return {"workspace": workspace, "forecast": found}, list(forecast_lines(found))


def _ran(job: Job, *, alone: bool) -> Printed:
    """Return what a command of stages prints."""
    from fusion.pipeline import StageRun

    found = job.result["stages"]
    runs = [
        StageRun(one["stage"], one["state"], one["seconds"], one["summary"], one.get("reason", ""))
        for one in found
    ]
    lines = [line for run in runs for line in run_lines(run)]
    whole = {"workspace": job.request.workspace, "stages": found}
    return (found[0] if alone else whole), lines


def _info(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection.forecasts import forecast_lines

    found = session.overview(workspace)
    content = {key: value for key, value in found.items() if key not in _BEYOND}
    lines = [workspace, *value_lines(content)]
    result: Mapping[str, Any] = {"mapolas_forecast": {}, "forecast": {}}
    if not content["problems"]:
        try:
            job = session.submit_job(workspace, "forecast", {}, priority=100)
            result = _done(session, job, given).result
        except RequestRefusedError as error:
            # Who may only read sees the rest.
            if error.code is not Refusal.FORBIDDEN:
                raise
    if result["forecast"]:
        lines += ["  forecast:", *(f"    {line}" for line in forecast_lines(result["forecast"]))]
    keys = ("mapolas_forecast", "forecast")
    return {**content, **{key: result[key] for key in keys}}, lines


def _by_job(kind: JobKind) -> Remote:
    """Return a command that a job does by the same options: its files are uploaded."""
    command, files = COMMANDS[kind], _FILES.get(kind, "kernel")

    def does(session: Session, workspace: str, given: Given) -> Printed:
        def send(path: Path) -> str:
            return session.upload(workspace, path, files, progress=not given["as_json"])

        parameters = json_of(command.options, given, send)
        if command.solution:
            parameters["solution"] = given["solution"]
        job = _done(session, session.submit_job(workspace, kind, parameters), given)
        for path in outputs_of(command.options, given):
            shown = not given["as_json"]
            session.download_output(workspace, path.name, path, progress=shown)
        return job.result, [line["text"] for line in session.log(job)]

    names = set(signature(with_shared_options(_taking(command.options))).parameters)
    return Remote(does, frozenset(names | ({"solution"} if command.solution else set())))


def _taking(options: type[Any]) -> Callable[..., None]:
    """Return a command that takes a class of options alone."""

    def command(given: Any) -> None:
        """Do nothing."""

    command.__annotations__ = {"given": options, "return": None}
    return command


def _init(session: Session, workspace: str, given: Given) -> Printed:
    if given["spc"] is not None and given["shape"] is not None:
        raise typer.BadParameter("give --spc or --shape, not both", param_hint="--shape")
    job = session.make_workspace(
        workspace,
        body=given["body"],
        shape=given["shape"],
        spc=given["spc"] or (),
        shape_unit=given["unit"],
        faces_from=given["faces_from"],
        progress=not given["as_json"],
    )
    content = _done(session, job, given).result
    return content, [
        f"Made {workspace} ({given['body']}): {content['maplets']} maplets, "
        f"{content['landmarks']} landmarks, {content['images']} images, "
        f"shape: {content['shape'] or 'none'}"
    ]


def _solutions(session: Session, workspace: str, _: Given) -> Printed:
    found = session.solutions(workspace)
    names = {"in_use": "in_use", "solutions": "solutions", "damaged": "problems"}
    return solution.listed({key: found[name] for key, name in names.items()})


def _solution(session: Session, workspace: str, given: Given) -> Printed:
    content = session.solution(workspace, given["name"])
    shown = {key: value for key, value in content.items() if key != "folder"}
    return content, value_lines(shown)


def _difference(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection import difference_lines

    found = session.solutions_compared(workspace, given["first"], given["second"])
    return {**found, "picture": None}, difference_lines(found)


def _wait(session: Session, _: str, given: Given) -> Printed:
    job = _done(session, session.job(given["job"]), given)
    return job.as_json(), [jobs.line_of(job)]


def _cancel(session: Session, _: str, given: Given) -> Printed:
    job = session.cancel(given["job"])
    return job.as_json(), [jobs.line_of(job)]


_stages_all = _stages()
_scale_stage = _stages("scale", settings={"method": "method"})
_JOB = frozenset({"job"})
REMOTE: Mapping[Callable[..., Any], Remote] = {
    folder.info: Remote(_info),
    folder.init: Remote(_init, frozenset({"spc", "shape", "unit", "faces_from", "body"})),
    altimetry.import_: _by_job(JobKind.IMPORT),
    images.images: _by_job(JobKind.IMAGES),
    states.sumfiles: _by_job(JobKind.SUMFILES),
    states.kernels: _by_job(JobKind.KERNELS),
    truth.assess: _by_job(JobKind.TRUTH_ASSESS),
    solution.use: _by_job(JobKind.SOLUTION_USE),
    solution.export: _by_job(JobKind.SOLUTION_EXPORT),
    solution.remove: _by_job(JobKind.SOLUTION_REMOVE),
    stages.mapolas: _stages("mapolas", settings={"source": "source", "gsd": "gsd_m"}),
    stages.register: _stages(
        "register", settings={"model": "model", "against": "against", "by": "by"}
    ),
    stages.fuse: _stages("fuse"),
    stages.bigmap: _stages("bigmap"),
    stages.scale: Remote(_scale, _scale_stage.takes - {"only", "within"} | {"apply", "name"}),
    stages.release: _stages("release", "report"),
    stages.run: Remote(_run, _RUN | {"forecast"}),
    solution.list_: Remote(_solutions),
    solution.show_: Remote(_solution, frozenset({"name"})),
    solution.diff: Remote(_difference, frozenset({"first", "second"})),
    jobs.list_: Remote(lambda session, workspace, _: jobs.listed(session, workspace)),
    jobs.show_: Remote(lambda session, _, given: jobs.described(session, given["job"]), _JOB),
    jobs.wait: Remote(_wait, _JOB),
    jobs.cancel: Remote(_cancel, _JOB),
    jobs.download: Remote(
        lambda session, workspace, given: jobs.downloaded(session, workspace, dict(given)),
        frozenset({"names", "folder", "solution"}),
    ),
}
"""What each command does on a server; those that are not here work on local files only."""
