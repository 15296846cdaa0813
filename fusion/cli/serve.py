"""``spcola serve``: a folder of workspaces as a service, its workers and backups."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from fusion.cli import tokens
from fusion.cli.options import (
    ClusterOption,
    JsonOption,
    PanelCommand,
    with_shared_options,
)
from fusion.cli.output import show
from fusion.cli.program import guarded
from fusion.cli.service_folder import FolderArgument, ServiceFolder, settings_of

if TYPE_CHECKING:
    from fusion.service.store import Store
    from fusion.service.work import Supervisor


TelemetryOption = Annotated[
    str,
    typer.Option(
        metavar="URL",
        envvar="OTEL_EXPORTER_OTLP_ENDPOINT",
        help="Collector of OpenTelemetry (OTLP over HTTP) for spans of requests, jobs, stages and "
        "items, as http://127.0.0.1:4318; needs spcola[telemetry].",
    ),
]
WorkerCount = Annotated[int, typer.Option(metavar="N", min=1, max=256, help="Worker processes.")]


class _ServeGroup(TyperGroup):
    """``spcola serve DIR`` is ``spcola serve start DIR``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in front of its arguments if none is named."""
        if args and args[0] not in (*self.commands, "--help"):
            args = ["start", *args]
        return list(super().parse_args(ctx, args))


app = typer.Typer(
    name="serve",
    cls=_ServeGroup,
    help="Serve workspaces over HTTP: jobs, results and a page. spcola serve DIR starts it.",
    epilog="Example: spcola serve missions; spcola serve token add missions anna --scope run",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@dataclass(frozen=True)
class EntranceOptions:
    """Where the service answers."""

    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Any but this machine's own needs tokens.")
    ] = "127.0.0.1"
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8080
    name: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HOST",
            help="A name under which users reach the service, as that of a proxy with TLS in "
            "front: tokens are needed then. Repeat it for several.",
        ),
    ] = None

    def url(self, port: int) -> str:
        """Return the address; `port` is the one that was taken."""
        return f"http://{f'[{self.host}]' if ':' in self.host else self.host}:{port}/"


def start(
    at: ServiceFolder,
    entrance: EntranceOptions = EntranceOptions(),
    workers: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, max=256, help="Worker processes; 0 if all run on other hosts."
        ),
    ] = 1,
    cluster: ClusterOption = "",
    telemetry: TelemetryOption = "",
    as_json: JsonOption = False,
) -> None:
    """Serve a folder until SIGTERM or Ctrl-C; running items are finished then."""
    from fusion.service.api import Entrance, Service, listening, run_server
    from fusion.service.state import logs_folder
    from fusion.service.upkeep import Cleaner, Preparer
    from fusion.service.work import start_log

    with at.alone(), _traced(telemetry, "server"), at.opened() as store:
        settings, logs = settings_of(at.folder), logs_folder(at.folder)
        guarded_by = Entrance.of(entrance.host, tuple(entrance.name or ()))
        start_log(logs, "server")
        _record_recovered(store, at.folder)
        with listening(entrance.host, entrance.port) as listener:
            url = entrance.url(listener.getsockname()[1])
            content = {"url": url, "folder": at.folder.resolve(), "workers": workers}
            lines = [f"serving {at.folder} at {url} with {workers} workers; end with Ctrl-C"]
            if guarded_by.token_needed and not store.tokens.all():
                lines.append(f"nobody has a token yet: spcola serve token add {at.folder} USER")
            crew = _supervisor(at, workers, cluster, store)
            service = Service(at.folder, store, settings.limits, crew=crew)
            started = partial(show, content, lines, as_json=as_json)
            crew.start()
            try:
                with Cleaner(service, logs, settings.keep), Preparer(service):
                    run_server(service, guarded_by, listener, started=started)
            finally:
                crew.stop()


def worker(
    at: ServiceFolder,
    workers: WorkerCount = 1,
    cluster: ClusterOption = "",
    telemetry: TelemetryOption = "",
) -> None:
    """Run workers alone, as on further hosts with the same folder and a PostgreSQL store."""
    from fusion.service.state import logs_folder
    from fusion.service.work import start_log

    with _traced(telemetry, "workers"), at.opened() as store:
        start_log(logs_folder(at.folder), "workers")
        _supervisor(at, workers, cluster, store).run()


def settings(folder: FolderArgument, as_json: JsonOption = False) -> None:
    """Print the settings of a service, also those that its file does not give."""
    from fusion.service.upkeep import settings_text

    found = settings_of(folder)
    lines = settings_text(found).rstrip().splitlines()
    show({"settings": asdict(found)}, lines, as_json=as_json)


def backup(
    at: ServiceFolder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A new file, SQLite.")],
    as_json: JsonOption = False,
) -> None:
    """Write jobs, tokens and audit log to a file, while the service runs."""
    with at.opened() as store:
        store.backup(file)
    show({"backup": file, "bytes": file.stat().st_size}, [f"{file}: written"], as_json=as_json)


def restore(
    at: ServiceFolder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="From spcola serve backup.")],
    as_json: JsonOption = False,
) -> None:
    """Replace jobs, tokens and audit log by those of a backup. Revoked tokens stay revoked."""
    with at.opened() as store:
        store.restore(file)
    show({"restored": file}, [f"{file}: restored"], as_json=as_json)


@contextmanager
def _traced(telemetry: str, name: str) -> Iterator[None]:
    """Send spans to a collector meanwhile, if one is named."""
    from fusion.service.tracing import COLLECTOR_VARIABLE, start_tracing

    former = os.environ.get(COLLECTOR_VARIABLE, "")
    # Workers have it from here.
    os.environ[COLLECTOR_VARIABLE] = telemetry
    try:
        with start_tracing(name):
            yield
    finally:
        os.environ[COLLECTOR_VARIABLE] = former


def _supervisor(at: ServiceFolder, count: int, cluster: str, store: Store) -> Supervisor:
    from fusion.runtime import usable_cores
    from fusion.service.work import Supervisor, WorkOptions, worker_command

    options = WorkOptions(
        threads=max(1, usable_cores() // max(1, count)),
        cluster=cluster,
        limits=settings_of(at.folder).parsers,
    )
    command = worker_command(at.folder.resolve(), at.store_place, options)
    return Supervisor(command, count, lost=store.lost)


def _record_recovered(store: Store, folder: Path) -> None:
    """List the runs of the workspaces in a store that was made in the place of a damaged one."""
    from fusion.service.api import Service
    from fusion.service.store import recovery

    if store.notes:
        service = Service(folder, store)
        places = {name: service.folder(name) for name in service.names()}
        for line in [*store.notes, *recovery.record_recovered_runs(store, places)]:
            typer.echo(line, err=True)


for _name, _command, _example in (
    ("start", start, "spcola serve missions --port 8080 --workers 2"),
    ("worker", worker, "spcola serve worker missions --store postgresql://spcola@db/spcola"),
    ("settings", settings, "spcola serve settings missions"),
    ("backup", backup, "spcola serve backup missions store-2026-11-23.sqlite"),
    ("restore", restore, "spcola serve restore missions store-2026-11-23.sqlite"),
):
    app.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(
        guarded(with_shared_options(_command))
    )
app.add_typer(tokens.app)
