"""The folder of a service: the options that name it, its lock, its settings and its store."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spcola.errors import SettingsError, WorkspaceError

if TYPE_CHECKING:
    from fusion.service.store import Store
    from fusion.service.upkeep import ServiceSettings

_LOCK_FILE = "server.lock"

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


@dataclass(frozen=True)
class ServiceFolder:
    """Options of the commands on a service: its folder, and its store if that is elsewhere."""

    folder: FolderArgument
    store: StoreOption = ""

    @property
    def store_place(self) -> str | Path:
        """Where the store is: its URL, or its file."""
        from fusion.service.state import STORE_NAME

        return self.store or state_folder(self.folder) / STORE_NAME

    @contextmanager
    def opened(self) -> Iterator[Store]:
        """Open the store; its folder is made if there is none."""
        require_packages()
        from fusion.service.store import Store

        state = _made_state_folder(self.folder)
        with Store(self.store_place, backups=state) as opened:
            yield opened

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Let no second service work on the folder meanwhile.

        Raises
        ------
        WorkspaceError
            If one does.
        """
        from fusion.runtime.folders import locked
        from fusion.runtime.folders.lock import BusyError

        state = _made_state_folder(self.folder)
        with ExitStack() as lock:
            try:
                lock.enter_context(locked(state / _LOCK_FILE))
            except BusyError as error:
                what, do = "another spcola serve serves this folder", "stop it, or use its address"
                raise WorkspaceError(what, self.folder, do) from error
            yield


def settings_of(folder: Path) -> ServiceSettings:
    """Return the settings of the service in a folder."""
    require_packages()
    from fusion.service.upkeep import SETTINGS_NAME, read_settings

    return read_settings(state_folder(folder) / SETTINGS_NAME)


def require_packages() -> None:
    """Raise SettingsError if the packages of the service are not installed."""
    if not all(map(find_spec, ("sqlalchemy", "fastapi", "uvicorn", "structlog"))):
        raise SettingsError(
            "needs further packages", "spcola serve", "install them: pip install 'spcola[service]'"
        )


def state_folder(folder: Path) -> Path:
    """Return where the state of a service is kept; raises WorkspaceError without its folder."""
    from fusion.service.state import STATE_FOLDER

    if not folder.is_dir():
        do = "give a folder" if folder.exists() else "create it"
        raise WorkspaceError("is not a folder", folder, do)
    return folder.resolve() / STATE_FOLDER


def _made_state_folder(folder: Path) -> Path:
    """Return the folder of the service's state; it is made for the eyes of its user only."""
    from fusion.runtime.folders import make_folder

    state = state_folder(folder)
    if not state.exists():
        make_folder(state)
        state.chmod(0o700)
    return state
