"""What is older than its age is removed, again and again, while the service runs."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from fusion.service.api import Service
from fusion.service.api.errors import RequestRefusedError
from fusion.service.jobs import JobState
from fusion.service.state import outputs_folder
from fusion.service.store import AuditEntry, StoreError, Upload
from fusion.service.store.records import UploadState
from fusion.service.store.store import LAST_CLEANING
from fusion.service.threads import Background
from fusion.service.upkeep.settings import Ages
from fusion.service.work.logs import log

_DAY_S = 86_400.0
_EVERY_S = 3600.0
_MOST_JOBS = 1_000_000
_UNENDED = (JobState.WAITING, JobState.RUNNING)


class Cleaner(Background):
    """Removes what is old, from a thread: at the start and every hour.

    Parameters
    ----------
    service : Service
    logs : Path
        Folder of the logs.
    ages : Ages
    clock : callable
        Seconds since 1970.
    """

    def __init__(
        self,
        service: Service,
        logs: Path,
        ages: Ages,
        *,
        clock: Callable[[], float] = time.time,
    ) -> None:
        super().__init__("cleaner")
        self._service, self._logs, self._ages, self._clock = service, logs, ages, clock

    def run(self) -> None:
        """Clean at the start and every hour."""
        while not self.ending.is_set():
            try:
                self.clean()
            except Exception as error:
                # A store that is busy, or a disk that fails: in an hour again.
                log.warning("old things were not removed", error=str(error))
            self.ending.wait(_EVERY_S)

    def clean(self) -> dict[str, int]:
        """Remove what is old; return how much of each kind."""
        store, ages = self._service.store, self._ages
        removed = {
            "uploads": self._remove_uploads(ages.uploads_days * _DAY_S),
            "outputs": self._remove_outputs(ages.outputs_days * _DAY_S),
            "events": store.retention.remove_events(ages.events_days * _DAY_S),
            "jobs": store.retention.remove_jobs(ages.jobs_days * _DAY_S),
            "audit": store.retention.remove_entries(ages.audit_days * _DAY_S),
            "logs": self._remove_logs(ages.logs_days * _DAY_S),
        }
        store.retention.remove_uploads(ages.uploads_days * _DAY_S)
        store.note_time(LAST_CLEANING)
        if any(removed.values()):
            log.info("old things are removed", **removed)
            store.audit.add(AuditEntry("spcola", "old-removed", details=removed))
        return removed

    def _remove_uploads(self, age_s: float) -> int:
        """Remove uploads that were given up, and the folders of those without a record."""
        uploads = self._service.store.uploads
        kept = uploads.kept()
        before = self._clock() - age_s
        old = [one for one in kept if one.changed < before]
        needed = self._needed() if old else set()
        count = sum(self._removed(one) for one in old if one.id not in needed)
        folder = self._service.uploads
        names = {upload.id for upload in kept}
        for path in folder.iterdir() if folder.is_dir() else ():
            with suppress(OSError):
                if path.name not in names and path.stat().st_mtime < before:
                    shutil.rmtree(path)
        return count

    def _removed(self, upload: Upload) -> bool:
        """Remove an upload unless a request is adding to it; return whether it is removed."""
        uploads = self._service.store.uploads
        with suppress(RequestRefusedError, StoreError), self._service.receiving(upload.id):
            if uploads.get(upload.id) == upload:
                uploads.end(upload.id, UploadState.REMOVED)
                shutil.rmtree(self._service.uploads / upload.id, ignore_errors=True)
                return True
        return False

    def _needed(self) -> set[str]:
        """Return what the parameters of jobs that have not ended name, ids of uploads among it."""
        jobs = self._service.store.jobs(states=_UNENDED, limit=_MOST_JOBS)
        named: set[str] = set()
        for job in jobs:
            # What it writes begins with a dot and its id.
            named |= {f".{job.id}", *_texts(job.request.parameters)}
        return named

    def _remove_outputs(self, age_s: float) -> int:
        """Remove outputs that were written long ago, and what lost workers left of theirs."""
        before = self._clock() - age_s
        old = [
            path
            for path in outputs_folder(self._service.root, "").glob("*/*")
            if _written(path) < before
        ]
        needed = self._needed() if old else set()
        return sum(_remove(path) for path in old if path.name not in needed)

    def _remove_logs(self, age_s: float) -> int:
        count = 0
        for path in self._logs.glob("*.jsonl*"):
            with suppress(OSError):
                if path.stat().st_mtime < self._clock() - age_s:
                    path.unlink()
                    count += 1
        return count


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in JSON; of ``name/file`` the name as well, which is that of an output."""
    if isinstance(value, str):
        yield from (value, value.partition("/")[0])
    parts = value.values() if isinstance(value, Mapping) else value
    for part in parts if isinstance(parts, Iterable) and not isinstance(parts, str) else ():
        yield from _texts(part)


def _written(path: Path) -> float:
    """Return when a file, or the last one in a folder, was written; never if it is gone."""
    try:
        times = [each.lstat().st_mtime for each in (path, *path.rglob("*"))]
    except OSError:
        return math.inf
    return max(times)


def _remove(path: Path) -> bool:
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
        return True
    return False
