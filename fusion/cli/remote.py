"""Commands with ``--server``: one table from a command to calls of the client."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping
from inspect import signature, unwrap
from pathlib import Path
from typing import Any, get_args

import typer

from fusion.cli import (
    altimetry,
    folder,
    images,
    jobs,
    look,
    photometry,
    solution,
    spc,
    stages,
    states,
    truth,
)
from fusion.cli.options import with_shared_options
from fusion.cli.output import show, value_lines
from fusion.cli.remote_jobs import Given, Printed, Remote, done, log_lines
from fusion.cli.remote_stages import RUN_OPTIONS, SCALE_OPTIONS, run, scale, stages_remotely
from fusion.client import Session, VersionWarning, connect
from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.commands.images import companions_of
from fusion.service.commands.json_options import json_of, outputs_of
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import JobKind
from fusion.service.state import WORKSPACE_NAME
from spcola.errors import SpcolaError

# Of the overview, what `info` does not print.
_FILES = {JobKind.IMPORT: "scan", JobKind.IMAGES: "image"}
_BEYOND = ("name", "bigmaps", "pairs", "released", "verdicts", "findings", "results")


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
            named = _as_typed(name, option.annotation)
            raise SpcolaError("cannot be given to a server", named, "leave it out")
    workspace = _workspace_of(given, remote)
    with _connected(server) as session:
        content, lines, error = remote.does(session, workspace, given)
    show(content, lines, as_json=given["as_json"])
    if error is not None:
        raise error


def _as_typed(name: str, annotation: Any) -> str:
    """Return an option as it is typed, such as --from."""
    for one in get_args(annotation):
        # Typer keeps the first name of an annotated option as its default.
        words = (getattr(one, "default", None), *(getattr(one, "param_decls", None) or ()))
        for word in words:
            if isinstance(word, str) and word.startswith("--"):
                return word.partition("/")[0]
    return f"--{name.replace('_', '-')}"


def _workspace_of(given: Given, remote: Remote) -> str:
    """Return the name of the workspace that a command names.

    Raises
    ------
    SpcolaError
        If it is none, or a file where the command works on whole workspaces.
    """
    path = Path(given["workspace"] if "workspace" in given else given["path"])
    name, *inside = path.parts or ("",)
    if re.fullmatch(WORKSPACE_NAME, name) and (remote.files or not inside):
        return name
    if path.is_file():
        raise SpcolaError("is a file of this machine", path, "leave out --server")
    do = "name one, or a file in it as WS/FILE" if remote.files else "give the name alone"
    raise SpcolaError("is no name of a workspace on a server", path, do)


def _connected(server: str) -> Session:
    """Return a session; another version of the server is a line on standard error."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", VersionWarning)
        session = connect(server)
    for each in found:
        typer.echo(f"warning: {each.message}", err=True)
    return session


def _inside(workspace: str, given: Given) -> str:
    """Return the name of a file in the workspace, or nothing if the workspace itself is named."""
    inside = Path(given["path"]).relative_to(workspace).as_posix()
    return "" if inside == "." else inside


def _look(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection.look import picture_path

    target = picture_path(given["path"], given["out"])
    options = {name: given[name] for name in ("unit", "faces_from") if given[name] is not None}
    content = session.look(
        workspace, target, file=_inside(workspace, given), options=options,
        progress=not given["as_json"],
    )  # fmt: skip
    return Printed(content, [str(target)])


def _info(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection.forecasts import forecast_lines

    if file := _inside(workspace, given):
        parameters = {"file": file, "faces_from": given["faces_from"]}
        job = session.submit_job(workspace, JobKind.INFO, parameters, priority=100)
        content = done(session, job, given).result
        return Printed(content, [str(given["path"]), *value_lines(content)])
    if given["faces_from"] != 1:
        raise typer.BadParameter("is of a file, not of a workspace", param_hint="--faces-from")
    found = session.overview(workspace)
    content = {key: value for key, value in found.items() if key not in _BEYOND}
    lines = [workspace, *value_lines(content)]
    result: Mapping[str, Any] = {"mapolas_forecast": {}, "forecast": {}}
    if not content["problems"]:
        try:
            job = session.submit_job(workspace, "forecast", {}, priority=100)
            result = done(session, job, given).result
        except RequestRefusedError as error:
            # Who may only read sees the rest.
            if error.code is not Refusal.FORBIDDEN:
                raise
    if result["forecast"]:
        lines += ["  forecast:", *(f"    {line}" for line in forecast_lines(result["forecast"]))]
    keys = ("mapolas_forecast", "forecast")
    return Printed({**content, **{key: result[key] for key in keys}}, lines)


def _by_job(kind: JobKind) -> Remote:
    """Return a command that a job does by the same options: its files are uploaded."""
    command, files = COMMANDS[kind], _FILES.get(kind, "kernel")

    def does(session: Session, workspace: str, given: Given) -> Printed:
        sent: list[Path] = []

        def send(path: Path) -> str:
            sent.append(path)
            return session.upload(workspace, path, files, progress=not given["as_json"])

        parameters = json_of(command.options, given, send)
        if command.companions:
            more = companions_of(sent, isd=given.get("states") == "isd" and not given["model"])
            parameters["companions"] = [send(path) for path in more]
        if command.solution:
            parameters["solution"] = given["solution"]
        job = done(session, session.submit_job(workspace, kind, parameters), given)
        for path in outputs_of(command.options, given):
            shown = not given["as_json"]
            session.download_output(workspace, path.name, path, progress=shown)
        return Printed(job.result, log_lines(session, job, "result"))

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
    content = done(session, job, given).result
    lines = [
        f"Made {workspace} ({given['body']}): {content['maplets']} maplets, "
        f"{content['landmarks']} landmarks, {content['images']} images, "
        f"shape: {content['shape'] or 'none'}",
        f"Next: spcola --server {session.place.name} import {workspace} FILE...",
    ]
    return Printed(content, lines)


def _solutions(session: Session, workspace: str, _: Given) -> Printed:
    found = session.solutions(workspace)
    names = {"in_use": "in_use", "solutions": "solutions", "damaged": "problems"}
    return Printed(*solution.listed({key: found[name] for key, name in names.items()}))


def _solution(session: Session, workspace: str, given: Given) -> Printed:
    content = session.solution(workspace, given["name"])
    shown = {key: value for key, value in content.items() if key != "folder"}
    return Printed(content, value_lines(shown))


def _difference(session: Session, workspace: str, given: Given) -> Printed:
    from fusion.inspection import difference_lines
    from fusion.inspection.look import picture_path

    names, out = (given["first"], given["second"]), given["out"]
    if out is None:
        found = session.solutions_compared(workspace, *names)
        return Printed({**found, "picture": None}, list(difference_lines(found)))
    target = picture_path(given["workspace"], out)
    shown = not given["as_json"]
    found = session.solutions_drawn(workspace, *names, target, progress=shown)
    return Printed(found, [*difference_lines(found), str(target)])


def _fuse(session: Session, workspace: str, given: Given) -> Printed:
    stages.check_source(given["source"], given["name"], force=given["force"])
    remote = _FUSE_IMAGES if given["source"] == "images" else _FUSE
    return remote.does(session, workspace, given)


_FUSE, _FUSE_IMAGES = stages_remotely("fuse"), _by_job(JobKind.FUSE_IMAGES)


def _wait(session: Session, _: str, given: Given) -> Printed:
    job = done(session, session.job(given["job"]), given)
    return Printed(job.as_json(), [jobs.line_of(job)])


def _cancel(session: Session, _: str, given: Given) -> Printed:
    job = session.cancel(given["job"])
    return Printed(job.as_json(), [jobs.line_of(job)])


_JOB = frozenset({"job"})
REMOTE: Mapping[Callable[..., Any], Remote] = {
    folder.info: Remote(_info, frozenset({"faces_from"}), files=True),
    look.look: Remote(_look, frozenset({"out", "unit", "faces_from"}), files=True),
    folder.init: Remote(_init, frozenset({"spc", "shape", "unit", "faces_from", "body"})),
    altimetry.import_: _by_job(JobKind.IMPORT),
    images.images: _by_job(JobKind.IMAGES),
    states.sumfiles: _by_job(JobKind.SUMFILES),
    states.kernels: _by_job(JobKind.KERNELS),
    truth.assess: _by_job(JobKind.TRUTH_ASSESS),
    photometry.fit: _by_job(JobKind.PHOTOMETRY_FIT),
    spc.tile: _by_job(JobKind.SPC_TILE),
    spc.register: _by_job(JobKind.SPC_REGISTER),
    spc.lithos: _by_job(JobKind.SPC_LITHOS),
    spc.albedo: _by_job(JobKind.SPC_ALBEDO),
    solution.use: _by_job(JobKind.SOLUTION_USE),
    solution.export: _by_job(JobKind.SOLUTION_EXPORT),
    solution.remove: _by_job(JobKind.SOLUTION_REMOVE),
    stages.mapolas: stages_remotely("mapolas", settings={"source": "source", "gsd": "gsd_m"}),
    stages.register: stages_remotely(
        "register", settings={"model": "model", "against": "against", "by": "by"}
    ),
    stages.fuse: Remote(_fuse, RUN_OPTIONS | {"source", "name"}),
    stages.bigmap: stages_remotely("bigmap"),
    stages.scale: Remote(scale, SCALE_OPTIONS),
    stages.release: stages_remotely("release", "report"),
    stages.report: stages_remotely("report"),
    stages.run: Remote(run, RUN_OPTIONS | {"forecast"}),
    solution.list_: Remote(_solutions),
    solution.show_: Remote(_solution, frozenset({"name"})),
    solution.diff: Remote(_difference, frozenset({"first", "second", "out"})),
    jobs.list_: Remote(lambda session, name, _: Printed(*jobs.listed(session, name))),
    jobs.show_: Remote(
        lambda session, _, given: Printed(*jobs.described(session, given["job"])), _JOB
    ),
    jobs.wait: Remote(_wait, _JOB),
    jobs.cancel: Remote(_cancel, _JOB),
    jobs.download: Remote(
        lambda session, name, given: Printed(*jobs.downloaded(session, name, dict(given))),
        frozenset({"names", "folder", "solution"}),
    ),
}
"""What each command does on a server; those that are not here work on local files only."""
