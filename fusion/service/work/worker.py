"""A worker: takes jobs from the queue and does one after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import structlog

from fusion import runtime
from fusion.runtime import Executor, json_value
from fusion.runtime.children import ProcessExecutor
from fusion.runtime.processes import limited_memory
from fusion.service.commands.stages import UnusableResultError
from fusion.service.jobs import Job, JobError, JobQueue
from fusion.service.store import LeaseLostError, UnknownJobError, Upload
from fusion.service.work.kinds import UPLOADED, Assignment, perform_job
from fusion.service.work.lease import Lease
from fusion.service.work.logs import log
from fusion.service.work.options import WorkOptions
from fusion.service.work.outcomes import Wait, job_error, reason_to_wait
from fusion.service.work.places import Places
from fusion.service.work.report import JobReport
from fusion.service.work.stopping import Stop, Stopper
from spcola.atomic import flush_folders

_STEP_S = 0.1
_RECORD_TRIES = 8
_DAY_S = 86_400.0


def work(
    queue: JobQueue,
    folder: Path,
    options: WorkOptions,
    *,
    name: str,
    upload: Callable[[str], Upload],
    beat: Callable[[], None] = lambda: None,
    idle: Callable[[], bool] = lambda: False,
) -> None:
    """Do jobs until SIGTERM, or Ctrl-C: what is under way then is finished item by item.

    It runs in the main thread of a process of its own, whose death costs nothing but the current
    items: another worker goes on with the job.

    Parameters
    ----------
    queue : JobQueue
    folder : Path
        A workspace, or a folder whose sub-folders are workspaces: the jobs reach no other.
    options : WorkOptions
    name : str
        Of this worker; no other one has it, nor had it.
    upload : callable
        Returns the record of an upload by its id.
    beat : callable
        Is called every second or so as a sign of life.
    idle : callable
        Is called when there is nothing to do; True ends the work.
    """
    worker = _Worker(queue, Places(folder.resolve(), upload), options, name, beat)
    with structlog.contextvars.bound_contextvars(worker=name), worker.stopper.heeding_signals():
        log.info("worker begins")
        written = time.monotonic()
        while not worker.stopper.draining:
            if time.monotonic() - written > _DAY_S:
                # So that the age of its file shows that somebody writes to it.
                written = time.monotonic()
                log.info("worker lives")
            if not worker.do_next():
                if idle():
                    break
                worker.rest(options.poll_s)
        log.info("worker ends")


class _Worker:
    """One worker."""

    def __init__(
        self,
        queue: JobQueue,
        places: Places,
        options: WorkOptions,
        name: str,
        beat: Callable[[], None],
    ) -> None:
        self._queue, self._places, self._options, self._name = queue, places, options, name
        self._beat = beat
        self.stopper = Stopper()

    def rest(self, seconds: float) -> None:
        """Wait for a time, or until the worker is to end."""
        until = time.monotonic() + seconds
        self._beat()
        while not self.stopper.draining and time.monotonic() < until:
            time.sleep(_STEP_S)

    def do_next(self) -> bool:
        """Do the next job; return whether there was one."""
        try:
            job = self._queue.claim(self._name, self._options.lease_s)
        except Exception as error:
            # The store may be back later: on a full disk, or a server that starts again.
            log.warning("the queue cannot be read", error=str(error))
            return False
        if job is None:
            return False
        request = job.request
        about = {"job": job.id, "workspace": request.workspace, "stage": ""}
        with structlog.contextvars.bound_contextvars(**about):
            log.info("job begins", kind=request.kind.value, tries=job.tries, user=request.user)
            begun = time.monotonic()
            code = self._done(job)
            log.info("job ends", outcome=code, seconds=round(time.monotonic() - begun, 3))
        return True

    def _done(self, job: Job) -> str:
        """Do a job and record what became of it; return that as a code."""
        again = {"force", "only", "within"} & job.request.parameters.keys()
        report = JobReport(job, partial(self._note, job), counts_stages=not again)
        outcome = "ended"
        try:
            outcome = self._attempted(job, report)
        finally:
            report.end(outcome)
        return outcome

    def _attempted(self, job: Job, report: JobReport) -> str:
        # What became of the job is recorded while its lease is renewed.
        with Lease(
            self._queue, job, self._name, self._options, self._progress(report), self.stopper,
            still_s=self._still_s(job),
        ):  # fmt: skip
            try:
                with self.stopper.stoppable():
                    result = self._result(job, report)
            except KeyboardInterrupt:
                return self._stopped(job)
            except Exception as error:
                return self._failed(job, error)
            self._record(lambda: self._queue.finish(job.id, self._name, result))
        return "finished"

    def _still_s(self, job: Job) -> float:
        """Return how long a job may make no progress: the tries of one file, and some more."""
        uploaded = job.request.kind in UPLOADED
        limits, tries = self._options.limits, self._options.tries
        return (tries + 1) * limits.seconds + 60.0 if uploaded else math.inf

    def _progress(self, report: JobReport) -> Callable[[], Any]:
        def now() -> Any:
            self._beat()
            return report.now()

        return now

    def _result(self, job: Job, report: JobReport) -> dict[str, Any]:
        with self._executor(job, report) as executor:
            result = perform_job(Assignment(job, self._places, executor, report))
        # A power cut must not take files of a job that is recorded as finished.
        flush_folders(self._places.workspace(job.request.workspace))
        return self._sent(result)

    def _sent(self, result: Mapping[str, Any]) -> dict[str, Any]:
        """Return a result as users see it."""
        return dict(json_value(self._places.without_folder_in(result)))

    @contextmanager
    def _executor(self, job: Job, report: JobReport) -> Iterator[Executor]:
        """Open what does the items of a job."""
        with ExitStack() as stack:
            uploaded = job.request.kind in UPLOADED
            if self._options.cluster and not uploaded:
                cluster = runtime.ClusterExecutor(self._options.cluster, seen=report.item_done)
                stack.callback(cluster.close)
                yield cluster
                return
            limits = self._options.limits if uploaded else None
            if limits is not None:
                stack.enter_context(limited_memory(limits.memory_mb))
            options = self._options
            made = ProcessExecutor(
                options.threads, limits=limits, tries=options.tries, seen=report.item_done
            )
            yield stack.enter_context(made)

    def _stopped(self, job: Job) -> str:
        """Record that the work was stopped."""
        reason = self.stopper.reason
        if reason is Stop.LOST:
            return reason.value
        if reason is Stop.TOO_LONG:
            text = f"made no progress for {self._still_s(job):g} s"
            self._record(lambda: self._queue.fail(job.id, self._name, JobError(reason, text)))
            return reason.value
        if reason is None:
            # Ctrl-C at a terminal.
            self.stopper.draining = True
        # A job that was to be cancelled does not wait again.
        self._record(lambda: self._queue.give_back(job.id, self._name))
        return (reason or Stop.DRAIN).value

    def _failed(self, job: Job, error: Exception) -> str:
        """Record that a job failed, or waits to be tried again."""
        wait = reason_to_wait(error, self._options)
        if wait is not None:
            return self._waits(job, wait)
        found = job_error(error)
        text = self._places.without_folder(found.text)
        if found.code == "internal":
            log.error("unexpected error", exc_info=error)
        failure = JobError(found.code, text, found.item)
        result = self._sent(error.result) if isinstance(error, UnusableResultError) else {}
        self._record(lambda: self._queue.fail(job.id, self._name, failure, result))
        return found.code

    def _waits(self, job: Job, wait: Wait) -> str:
        again = f"{wait.text}; tried again in {wait.seconds:g} s"
        self._note(job, again, "warning", code=wait.code)
        self._record(lambda: self._queue.give_back(job.id, self._name, wait_s=wait.seconds))
        return wait.code

    def _note(self, job: Job, text: str, level: str, **code: str) -> None:
        """Add a line to the log of the job, and to that of the worker."""
        text, content = self._places.without_folder(text), {"level": level, **code}
        log.info("note", text=text, **code)
        try:
            self._queue.note(job.id, text, content)
        except Exception as error:
            log.warning("a note was not recorded", error=str(error))

    def _record(self, change: Callable[[], None]) -> None:
        """Record a change of state; a store that does not answer is asked again.

        If it never does, the lease ends, and the job is done again from its finished items.
        """
        for number in range(_RECORD_TRIES):
            try:
                change()
            except (LeaseLostError, UnknownJobError):
                log.warning("the job belongs to another worker by now, or is no more")
            except Exception as error:
                log.warning("the outcome was not recorded", error=str(error))
                self._beat()
                time.sleep(min(2.0**number * _STEP_S, self._options.lease_s / 4.0))
                continue
            return
