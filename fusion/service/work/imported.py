"""Uploads that are not needed any more: what was in them lies in the workspace."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

from fusion.service.jobs import Job, JobKind, JobState
from fusion.service.store import Store, Upload
from fusion.service.store.records import UploadState

__all__ = ["imported_uploads"]

_IMPORTS = {JobKind.IMPORT, JobKind.IMAGES, JobKind.INIT}
_FILES = ("uploads", "companions", "shape")
_PAGE = 1000


def imported_uploads(store: Store, workspace: str) -> list[Upload]:
    """Return the complete uploads that a finished job has brought into a workspace.

    They are the files of imports of scans and images, and SPC files and shape of a new workspace.
    Cameras, kernels and tables are not: other jobs may take them again. Nor is what a job names
    that has not ended.
    """
    done: set[str] = set()
    needed: set[str] = set()
    for job in _jobs(store, workspace):
        given = job.request.parameters
        if not job.state.ended:
            needed |= set(_texts(given))
        elif job.state is JobState.FINISHED and job.request.kind in _IMPORTS:
            done |= set(_texts([given.get(name) for name in _FILES]))
    kept = store.uploads.kept(workspace)
    return [one for one in kept if one.state is UploadState.COMPLETE and one.id in done - needed]


def _jobs(store: Store, workspace: str) -> Iterator[Job]:
    found = store.jobs(workspaces=[workspace], limit=_PAGE)
    while found:
        yield from found
        found = store.jobs(workspaces=[workspace], before=found[-1].id, limit=_PAGE)


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts among the values in JSON."""
    if isinstance(value, dict):
        yield from _texts(list(value.values()))
    elif isinstance(value, list | tuple):
        yield from chain.from_iterable(map(_texts, value))
    elif isinstance(value, str):
        yield value
