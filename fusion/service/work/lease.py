"""The lease of a job, renewed while another thread works on it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from fusion.service.jobs import Job, JobProgress, JobQueue
from fusion.service.store import LeaseLostError
from fusion.service.work.logs import log
from fusion.service.work.options import WorkOptions
from fusion.service.work.stopping import Stop, Stopper

_PATIENCE_S = 15.0


class Lease:
    """Renews the lease of a job, with its progress, until the context ends.

    Parameters
    ----------
    queue : JobQueue
    job : Job
    worker : str
    options : WorkOptions
    progress : callable
        Returns how far the job is.
    stopper : Stopper
        Is used when the job is cancelled, lost, or takes longer than `most_s`.
    most_s : float
        Work that goes on 15 s later, as a library hangs, ends with its process.
    """

    def __init__(
        self,
        queue: JobQueue,
        job: Job,
        worker: str,
        options: WorkOptions,
        progress: Callable[[], JobProgress],
        stopper: Stopper,
        *,
        most_s: float = float("inf"),
    ) -> None:
        self._queue, self._job, self._worker, self._options = queue, job, worker, options
        self._progress, self._stopper = progress, stopper
        self._most_s, self._begun = most_s, time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._renewals, name="lease", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _renewals(self) -> None:
        while not self._ended.wait(self._options.renew_s):
            taken = time.monotonic() - self._begun
            if taken > self._most_s + _PATIENCE_S:
                log.error("the job hangs: its worker ends", job=self._job.id)
                os.kill(os.getpid(), signal.SIGKILL)
            if taken > self._most_s:
                self._stopper.stop(Stop.TOO_LONG)
            try:
                self._renew()
            except LeaseLostError:
                self._stopper.stop(Stop.LOST)
                return
            except Exception as error:
                # A store that does not answer for a while is no reason to lose hours of work.
                log.warning("the lease was not renewed", job=self._job.id, error=str(error))

    def _renew(self) -> None:
        """Renew the lease once, and stop the work if it was cancelled."""
        seconds = self._options.lease_s
        if self._queue.renew(self._job.id, self._worker, seconds, self._progress()):
            self._stopper.stop(Stop.CANCEL)
