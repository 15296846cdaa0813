"""Parameters of jobs, checked before a job waits for a worker in vain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fusion.service.api.folder import ServedFolder
from fusion.service.jobs import JobKind
from fusion.service.work import parameters_of

__all__ = ["check_parameters"]


def check_parameters(
    folder: ServedFolder, workspace: str, kind: JobKind, given: Mapping[str, Any]
) -> None:
    """Check that a job can begin with these parameters.

    Raises
    ------
    RequestRefusedError
        If there is no such workspace.
    SpcolaError
        If a parameter or a setting is unknown or not allowed, or there is no such solution.
    """
    checked = parameters_of(kind, given)
    if kind is JobKind.INIT:
        folder.place(workspace)
        return
    opened = folder.workspace(workspace, getattr(checked, "solution", ""))
    if settings := getattr(checked, "settings", None):
        opened.settings().with_tables(settings, "settings")
