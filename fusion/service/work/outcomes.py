"""What an error means for a job: it failed, or waits to be tried again."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass

from fusion.runtime.children import PoisonousItemError
from fusion.runtime.executor import ClusterError
from fusion.runtime.folders.lock import BusyError
from fusion.service.faults import fault_of
from fusion.service.jobs import JobError
from fusion.service.store import StoreError, StoreFault
from fusion.service.work.options import WorkOptions
from spcola.errors import DiskFullError, printable

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@dataclass(frozen=True)
class Wait:
    """A job has to wait: how long, and why."""

    seconds: float
    code: str
    text: str


def job_error(error: Exception) -> JobError:
    """Return why a job failed, with its code."""
    code = fault_of(error).code
    text = printable(str(error)) or "no message"
    if code == "internal":
        text = f"unexpected {type(error).__name__}: {text}"
    elif code == "out-of-memory":
        text = f"out of memory ({text}); take fewer threads, or a coarser or smaller grid"
    return JobError(code, text, error.item if isinstance(error, PoisonousItemError) else "")


def reason_to_wait(error: Exception, options: WorkOptions) -> Wait | None:
    """Return why a job is to be tried again; None if that would not help."""
    text = printable(str(error))
    if _is_full_disk(error):
        return Wait(options.disk_wait_s, "disk-full", f"no space is left to write: {text}")
    if isinstance(error, BusyError):
        return Wait(options.busy_wait_s, "busy", text)
    if isinstance(error, ClusterError):
        return Wait(options.cluster_wait_s, "cluster-lost", text)
    return None


def _is_full_disk(error: BaseException) -> bool:
    """Return whether a full disk is among the causes of an error."""
    for one in _chain(error):
        if isinstance(one, DiskFullError) or getattr(one, "errno", None) in _FULL:
            return True
        if isinstance(one, sqlite3.Error) and one.sqlite_errorname == "SQLITE_FULL":
            return True
        if isinstance(one, StoreError) and one.code is StoreFault.DISK_FULL:
            return True
    return False


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
