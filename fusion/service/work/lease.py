"""The lease of a job, renewed while another thread works on it."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable

from fusion.service.jobs import Job, JobProgress, JobQueue
from fusion.service.store import LeaseLostError, UnknownJobError
from fusion.service.threads import Background
from fusion.service.work.logs import log
from fusion.service.work.options import WorkOptions
from fusion.service.work.stopping import Stop, Stopper

_PATIENCE_S = 15.0


class Lease(Background):
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
        Is used when the job is cancelled, lost, or makes no progress for `still_s`.
    still_s : float
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
        still_s: float = math.inf,
    ) -> None:
        super().__init__("lease")
        self._queue, self._job, self._worker, self._options = queue, job, worker, options
        self._progress, self._stopper = progress, stopper
        self._still_s, self._last, self._since = still_s, ("", "", 0), time.monotonic()

    def run(self) -> None:
        """Renew the lease until the context ends."""
        while not self.ending.wait(self._options.renew_s):
            progress = self._progress()
            self._check_still(progress)
            try:
                self._renew(progress)
            except (LeaseLostError, UnknownJobError):
                # Also where a backup was restored that does not have the job.
                self._stopper.stop(Stop.LOST)
                return
            except Exception as error:
                # A store that does not answer for a while is no reason to lose hours of work.
                log.warning("the lease was not renewed", job=self._job.id, error=str(error))

    def _check_still(self, progress: JobProgress) -> None:
        """Stop work that makes no progress."""
        now = (progress.stage, progress.task, progress.done)
        if now != self._last:
            self._last, self._since = now, time.monotonic()
        still = time.monotonic() - self._since
        if still > self._still_s + _PATIENCE_S:
            log.error("the job hangs: its worker ends", job=self._job.id)
            os.kill(os.getpid(), signal.SIGKILL)
        if still > self._still_s:
            self._stopper.stop(Stop.TOO_LONG)

    def _renew(self, progress: JobProgress) -> None:
        """Renew the lease once, and stop the work if it was cancelled."""
        seconds = self._options.lease_s
        if self._queue.renew(self._job.id, self._worker, seconds, progress):
            self._stopper.stop(Stop.CANCEL)
