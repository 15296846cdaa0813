"""Parameters of jobs, checked before a job waits for a worker in vain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fusion.service.api.service import Service
from fusion.service.jobs import JobKind
from fusion.service.work import parameters_of


def check_parameters(
    service: Service, workspace: str, kind: JobKind, given: Mapping[str, Any]
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
        service.place(workspace)
        return
    opened = service.workspace(workspace, getattr(checked, "solution", ""))
    if settings := getattr(checked, "settings", None):
        opened.settings().with_tables(settings, "settings")
