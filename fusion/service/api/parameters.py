"""Parameters of jobs, checked before a job waits for a worker in vain."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fusion.service.api.errors import Refusal, RequestRefusedError
from fusion.service.api.folder import ServedFolder
from fusion.service.commands.fields import Mark
from fusion.service.commands.json_options import options_of
from fusion.service.commands.table import COMMANDS
from fusion.service.jobs import JobKind
from fusion.service.store.uploads import Uploads
from fusion.service.work import Places, parameters_of
from fusion.service.work.places import two_of_one_name
from spcola.errors import WorkspaceError

__all__ = ["check_parameters"]


def check_parameters(
    folder: ServedFolder,
    uploads: Uploads,
    workspace: str,
    kind: JobKind,
    given: Mapping[str, Any],
    *,
    follows: bool = False,
) -> None:
    """Check that a job can begin with these parameters; no file is read.

    Parameters
    ----------
    folder : ServedFolder
    uploads : Uploads
        Of the store.
    workspace : str
    kind : JobKind
    given : mapping
        JSON of a user.
    follows : bool
        Whether it comes after a job that may make the workspace or the solution.

    Raises
    ------
    RequestRefusedError
        If there is no such workspace.
    SpcolaError
        If a parameter or a setting is unknown or not allowed, parameters contradict each other, or
        there is no such stage, solution or complete upload. It names those that there are. If two
        files have one name.
    """
    checked = parameters_of(kind, given)
    places = Places(folder.root, uploads.get)
    if kind is JobKind.INIT:
        folder.place(workspace)
        sent = (*getattr(checked, "uploads", ()), getattr(checked, "shape", None))
        places.uploads(workspace, [one for one in sent if one is not None])
        return
    _check_workspace(folder, workspace, checked, follows=follows)
    if kind in COMMANDS:
        named: dict[str, Path] = {}

        def path_of(value: Any, mark: Mark | None) -> Path:
            for one in value if mark is Mark.FOLDER else [value]:
                # An earlier job may have yet to write an output.
                if mark is not Mark.OUTPUT and isinstance(one, str):
                    file = places.upload_file(workspace, one)
                    if COMMANDS[kind].together and named.setdefault(file.name, file) != file:
                        raise two_of_one_name(file.name)
            return Path(str(value) if mark is Mark.OUTPUT else "file")

        options_of(COMMANDS[kind].options, checked, path_of)
        path_of(getattr(checked, "companions", ()), Mark.FOLDER)


def _check_workspace(folder: ServedFolder, workspace: str, checked: Any, *, follows: bool) -> None:
    """Check solution and settings of a job; raises RequestRefusedError or SpcolaError."""
    solution = getattr(checked, "solution", "")
    try:
        # An assessment of all solutions reads each.
        opened = folder.workspace(workspace, "" if solution == "all" else solution)
    except RequestRefusedError:
        if not follows:
            raise
        folder.place(workspace)
        return
    except WorkspaceError as error:
        if not follows:
            raise RequestRefusedError(Refusal.INVALID, error.what, "solution", error.do) from error
        return
    if settings := getattr(checked, "settings", None):
        opened.settings().with_tables(settings, "settings")
