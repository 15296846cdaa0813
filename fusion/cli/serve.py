"""``spcola serve``: a folder of workspaces as a service, its workers, tokens and backups."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from fusion.cli.options import (
    ClusterOption,
    JsonOption,
    PanelCommand,
    with_shared_options,
)
from fusion.cli.output import show
from fusion.cli.program import guarded
from spcola.errors import SettingsError, WorkspaceError

if TYPE_CHECKING:
    from fusion.service.store import Store, Token
    from fusion.service.upkeep import ServiceSettings
    from fusion.service.work import Supervisor

_LOCK_FILE = "server.lock"
_DAY_S = 86_400.0

FolderArgument = Annotated[
    Path,
    typer.Argument(
        metavar="DIR", help="A workspace, or a folder whose sub-folders are workspaces."
    ),
]
StoreOption = Annotated[
    str,
    typer.Option(
        metavar="URL",
        envvar="SPCOLA_STORE",
        help="Where jobs, tokens and the audit log are: postgresql://USER@HOST/NAME; by default "
        "SQLite in DIR/.service. Give a password in the variable SPCOLA_STORE, not here.",
    ),
]
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
tokens = typer.Typer(
    name="token",
    help="Tokens: who may do what over the network.",
    epilog="Example: spcola serve token add missions anna --scope run --workspace bennu",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def start(
    folder: FolderArgument,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Any but this machine's own needs tokens.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes a free one.")] = 8080,
    name: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HOST",
            help="A name under which users reach the service, as that of a proxy with TLS in "
            "front: tokens are needed then. Repeat it for several.",
        ),
    ] = None,
    workers: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, max=256, help="Worker processes; 0 if all run on other hosts."
        ),
    ] = 1,
    store: StoreOption = "",
    cluster: ClusterOption = "",
    telemetry: TelemetryOption = "",
    as_json: JsonOption = False,
) -> None:
    """Serve a folder until SIGTERM or Ctrl-C; running items are finished then."""
    from fusion.service.api import Entrance, Service, listening, run_server
    from fusion.service.state import logs_folder
    from fusion.service.upkeep import Cleaner
    from fusion.service.work import start_log

    with _alone(folder), _traced(telemetry, "server"), _opened(folder, store) as opened:
        settings = _settings(folder)
        entrance = Entrance.of(host, tuple(name or ()))
        start_log(logs_folder(folder), "server")
        _record_recovered(opened, folder)
        with listening(host, port) as listener:
            bound = listener.getsockname()[1]
            url = f"http://{f'[{host}]' if ':' in host else host}:{bound}/"
            content = {"url": url, "folder": folder.resolve(), "workers": workers}
            lines = [f"serving {folder} at {url} with {workers} workers; end with Ctrl-C"]
            if entrance.token_needed and not opened.tokens.all():
                lines.append(f"nobody has a token yet: spcola serve token add {folder} USER")
            crew = _supervisor(folder, store, workers, cluster, opened)
            service = Service(folder, opened, settings.limits, crew=crew)
            started = partial(show, content, lines, as_json=as_json)
            crew.start()
            try:
                with Cleaner(service, logs_folder(folder), settings.keep):
                    run_server(service, entrance, listener, started=started)
            finally:
                crew.stop()


def worker(
    folder: FolderArgument,
    workers: WorkerCount = 1,
    store: StoreOption = "",
    cluster: ClusterOption = "",
    telemetry: TelemetryOption = "",
) -> None:
    """Run workers alone, as on further hosts with the same folder and a PostgreSQL store."""
    from fusion.service.state import logs_folder
    from fusion.service.work import start_log

    with _traced(telemetry, "workers"), _opened(folder, store) as opened:
        start_log(logs_folder(folder), "workers")
        _supervisor(folder, store, workers, cluster, opened).run()


def settings(folder: FolderArgument, as_json: JsonOption = False) -> None:
    """Print the settings of a service, also those that its file does not give."""
    from fusion.service.upkeep import settings_text

    found = _settings(folder)
    lines = settings_text(found).rstrip().splitlines()
    show({"settings": asdict(found)}, lines, as_json=as_json)


def backup(
    folder: FolderArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A new file, SQLite.")],
    store: StoreOption = "",
    as_json: JsonOption = False,
) -> None:
    """Write jobs, tokens and audit log to a file, while the service runs."""
    with _opened(folder, store) as opened:
        opened.backup(file)
    show({"backup": file, "bytes": file.stat().st_size}, [f"{file}: written"], as_json=as_json)


def restore(
    folder: FolderArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="From spcola serve backup.")],
    store: StoreOption = "",
    as_json: JsonOption = False,
) -> None:
    """Replace jobs, tokens and audit log by those of a backup. Revoked tokens stay revoked."""
    with _opened(folder, store) as opened:
        opened.restore(file)
    show({"restored": file}, [f"{file}: restored"], as_json=as_json)


def token_add(
    folder: FolderArgument,
    user: Annotated[str, typer.Argument(metavar="USER", help="In whose name it acts.")],
    scope: Annotated[
        str, typer.Option(help="read, run (with read) or admin (with both).")
    ] = "read",
    workspace: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Where; by default in all. Repeat it for several."),
    ] = None,
    days: Annotated[
        float | None, typer.Option(metavar="D", min=0.001, max=36_500.0, help="Until it expires.")
    ] = None,
    label: Annotated[str, typer.Option(metavar="TEXT", help="What it is for.")] = "",
    store: StoreOption = "",
    as_json: JsonOption = False,
) -> None:
    """Make a token and print its secret, which cannot be read again."""
    from fusion.service.store import Scope

    if scope not in list(Scope):
        raise typer.BadParameter(f"{scope!r} is none of {', '.join(Scope)}", param_hint="--scope")
    scopes = dict.fromkeys(workspace or ["*"], Scope(scope))
    lifetime_s = None if days is None else days * _DAY_S
    with _opened(folder, store) as opened:
        secret, token = opened.tokens.make(user, scopes, name=label, lifetime_s=lifetime_s)
    show({**asdict(token), "secret": secret}, [secret], as_json=as_json)


def token_list(
    folder: FolderArgument, store: StoreOption = "", as_json: JsonOption = False
) -> None:
    """List the tokens, without their secrets."""
    with _opened(folder, store) as opened:
        found = opened.tokens.all()
    show(
        {"tokens": [asdict(token) for token in found]},
        [_token_line(token) for token in found] or ["no tokens"],
        as_json=as_json,
    )


def token_revoke(
    folder: FolderArgument,
    token: Annotated[str, typer.Argument(metavar="ID", help="From spcola serve token list.")],
    store: StoreOption = "",
    as_json: JsonOption = False,
) -> None:
    """Revoke a token; a running service refuses it within two seconds."""
    with _opened(folder, store) as opened:
        opened.tokens.revoke(token)
    show({"revoked": token}, [f"{token}: revoked"], as_json=as_json)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let no second service work on a folder meanwhile."""
    from fusion.runtime.folders import locked
    from fusion.runtime.folders.lock import BusyError

    state = _made_state_folder(folder)
    with ExitStack() as lock:
        try:
            lock.enter_context(locked(state / _LOCK_FILE))
        except BusyError as error:
            what, do = "another spcola serve serves this folder", "stop it, or use its address"
            raise WorkspaceError(what, folder, do) from error
        yield


@contextmanager
def _opened(folder: Path, store: str) -> Iterator[Store]:
    _require_packages()
    from fusion.service.state import STORE_NAME
    from fusion.service.store import Store

    state = _made_state_folder(folder)
    with Store(store or state / STORE_NAME, backups=state) as opened:
        yield opened


def _require_packages() -> None:
    if not all(map(find_spec, ("sqlalchemy", "fastapi", "uvicorn", "structlog"))):
        raise SettingsError(
            "needs further packages", "spcola serve", "install them: pip install 'spcola[service]'"
        )


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


def _settings(folder: Path) -> ServiceSettings:
    _require_packages()
    from fusion.service.upkeep import SETTINGS_NAME, read_settings

    return read_settings(_state_folder(folder) / SETTINGS_NAME)


def _state_folder(folder: Path) -> Path:
    from fusion.service.state import STATE_FOLDER

    if not folder.is_dir():
        do = "give a folder" if folder.exists() else "create it"
        raise WorkspaceError("is not a folder", folder, do)
    return folder.resolve() / STATE_FOLDER


def _made_state_folder(folder: Path) -> Path:
    """Return the folder of the service's state; it is made for the eyes of its user only."""
    from fusion.runtime.folders import make_folder

    state = _state_folder(folder)
    if not state.exists():
        make_folder(state)
        state.chmod(0o700)
    return state


def _supervisor(folder: Path, store: str, count: int, cluster: str, opened: Store) -> Supervisor:
    from fusion.runtime import usable_cores
    from fusion.service.state import STORE_NAME
    from fusion.service.work import Supervisor, WorkOptions, worker_command

    options = WorkOptions(
        threads=max(1, usable_cores() // max(1, count)),
        cluster=cluster,
        limits=_settings(folder).parsers,
    )
    place = store or _state_folder(folder) / STORE_NAME
    command = worker_command(folder.resolve(), place, options)
    return Supervisor(command, count, lost=opened.lost)


def _record_recovered(store: Store, folder: Path) -> None:
    """List the runs of the workspaces in a store that was made in the place of a damaged one."""
    from fusion.service.api import Service
    from fusion.service.store import recovery

    if store.notes:
        service = Service(folder, store)
        places = {name: service.folder(name) for name in service.names()}
        for line in [*store.notes, *recovery.record_recovered_runs(store, places)]:
            typer.echo(line, err=True)


def _token_line(token: Token) -> str:
    where = ", ".join(f"{scope.value} in {place}" for place, scope in token.scopes.items())
    state = "revoked" if not math.isnan(token.revoked) else "valid"
    if not math.isnan(token.expires) and state == "valid":
        state = f"until {datetime.fromtimestamp(token.expires, UTC):%Y-%m-%d %H:%M} UTC"
    return f"{token.id}  {token.user}  {where}  {state}  {token.name}".rstrip()


_COMMANDS = (
    (app, "start", start, "spcola serve missions --port 8080 --workers 2"),
    (app, "worker", worker, "spcola serve worker missions --store postgresql://spcola@db/spcola"),
    (app, "settings", settings, "spcola serve settings missions"),
    (app, "backup", backup, "spcola serve backup missions store-2026-11-23.sqlite"),
    (app, "restore", restore, "spcola serve restore missions store-2026-11-23.sqlite"),
    (tokens, "add", token_add, "spcola serve token add missions anna --scope run --days 90"),
    (tokens, "list", token_list, "spcola serve token list missions"),
    (tokens, "revoke", token_revoke, "spcola serve token revoke missions 4f1d2c3b5a69"),
)
for _group, _name, _function, _example in _COMMANDS:
    _group.command(_name, cls=PanelCommand, epilog=f"Example: {_example}")(
        guarded(with_shared_options(_function))
    )
app.add_typer(tokens)
