"""``spcola job`` and ``spcola download``: what is left behind in a service or a folder's queue."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusion.cli.options import JsonOption, PanelCommand, WorkspaceArgument
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.service.commands import SolutionOption

if TYPE_CHECKING:
    from fusion.client import Session
    from fusion.service.jobs import Job

app = typer.Typer(
    name="job",
    help="Jobs of a service: list, show, wait for, cancel; with --server, or in a served folder.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="Its number, from job list.")]


def list_(workspace: WorkspaceArgument, as_json: JsonOption = False) -> None:
    """List the jobs of a workspace, the newest first."""
    with _session(workspace) as (session, name):
        show(*listed(session, name), as_json=as_json)


def show_(workspace: WorkspaceArgument, job: JobArgument, as_json: JsonOption = False) -> None:
    """Show a job with its progress, its log, and its result or error."""
    with _session(workspace) as (session, _):
        show(*described(session, job), as_json=as_json)


def wait(workspace: WorkspaceArgument, job: JobArgument, as_json: JsonOption = False) -> None:
    """Wait until a job has ended; the exit code is 1 if it failed."""
    with _session(workspace) as (session, _):
        found = session.wait(job, progress=not as_json)
        show(found.as_json(), [line_of(found)], as_json=as_json)


def cancel(workspace: WorkspaceArgument, job: JobArgument, as_json: JsonOption = False) -> None:
    """Cancel a job; one that runs ends with its current items, which are kept."""
    with _session(workspace) as (session, _):
        found = session.cancel(job)
        show(found.as_json(), [line_of(found)], as_json=as_json)


def download(
    workspace: WorkspaceArgument,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="PRODUCT...", help="By default all.")
    ] = None,
    folder: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Where to; made if it is not there.")
    ] = Path("release"),
    solution: SolutionOption = "",
    as_json: JsonOption = False,
) -> None:
    """Fetch products of a release with their manifest, and compare their checksums.

    A download that was interrupted goes on.
    """
    with _session(workspace) as (session, name):
        given = {"folder": folder, "names": names, "solution": solution, "as_json": as_json}
        show(*downloaded(session, name, given), as_json=as_json)


def listed(session: Session, workspace: str) -> tuple[dict[str, Any], list[str]]:
    """Return what ``job list`` prints."""
    found = session.jobs(workspace)
    lines = [line_of(job) for job in found] or ["no jobs"]
    return {"jobs": [job.as_json() for job in found]}, lines


def described(session: Session, identity: str) -> tuple[dict[str, Any], list[str]]:
    """Return what ``job show`` prints."""
    job, log = session.job(identity), session.log(identity)
    lines = [line_of(job), *(f"  {_time(line['time'])}  {line['text']}" for line in log)]
    return {**job.as_json(), "log": log}, lines


def downloaded(
    session: Session, workspace: str, given: dict[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """Return what ``download`` prints."""
    found = session.download_products(
        workspace,
        given["folder"],
        given["names"] or (),
        solution=given["solution"],
        progress=not given["as_json"],
    )
    return {"files": found}, [str(path) for path in found]


def line_of(job: Job) -> str:
    """Return a line about a job."""
    progress = job.progress
    parts = [
        job.id,
        job.request.kind.value,
        job.request.user,
        _time(job.submitted),
        job.state.value,
    ]
    if progress.task and not job.state.ended:
        parts.append(
            f"{progress.stage} {progress.task} {progress.done} of {progress.total}".strip()
        )
    if job.error is not None:
        parts.append(f"{job.error.text} [{job.error.code}]")
    return "  ".join(parts)


@contextmanager
def _session(workspace: Path) -> Iterator[tuple[Session, str]]:
    """Open the folder that is served, and yield it with the name of the workspace."""
    from fusion.client import connect
    from fusion.service.state import STATE_FOLDER

    root = workspace.resolve()
    served = root if (root / STATE_FOLDER).is_dir() else root.parent
    with connect(served if (served / STATE_FOLDER).is_dir() else root) as session:
        yield session, root.name


def _time(seconds: float) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}"


for _name, _command, _example in (
    ("list", list_, "spcola --server http://localhost:8080 job list bennu"),
    ("show", show_, "spcola --server http://localhost:8080 job show bennu 00000001-113f7baa"),
    ("wait", wait, "spcola --server http://localhost:8080 job wait bennu 00000001-113f7baa"),
    ("cancel", cancel, "spcola --server http://localhost:8080 job cancel bennu 00000001-113f7baa"),
):
    app.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(guarded(_command))
