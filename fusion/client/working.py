"""Calls that have something done: jobs, submitted, watched and cancelled."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fusion.client.errors import failure, job_name
from fusion.client.place import Place
from fusion.client.progress import job_bar
from fusion.client.steps import Emitting, Pause, Steps, call, stream
from fusion.service.jobs import Event, Job, JobKind, JobRequest, JobState

_FIRST_LOOK_S, _LOOK_S = 0.1, 1.0
_SOON = 100


class Working:
    """Calls on jobs; a job is named by its `id`, or by what `submit` returned."""

    place: Place

    @call
    def submit(
        self,
        /,
        workspace: str,
        stages: Sequence[str] = (),
        *,
        priority: int = 0,
        after: Sequence[Job | str] = (),
        key: str = "",
        **parameters: Any,
    ) -> Steps[Job]:
        """Submit a run of stages: all that are not up to date if none is named.

        A request that got no answer is repeated with the same key, and never makes two jobs.

        Parameters
        ----------
        workspace : str
        stages : sequence of str
        priority : int
            From -100 to 100.
        after : sequence of Job or str
            Jobs that have to be finished before.
        key : str
            The same key again gives the first job; by default a new one.
        **parameters
            `settings`, tables as in ``spcola.toml``; `solution`, by default the one in use;
            `only`, items of one stage; `within`, those inside ``LAT,LON,RADIUS_M``; `accept`,
            codes of findings in spite of which a result is used; `force`, also what is up to date.

        Returns
        -------
        Job
        """
        given = {"stages": list(stages), **parameters}
        request = _request(workspace, JobKind.RUN, given, priority, after, key)
        return (yield from self.place.submit(request))

    @call
    def submit_job(
        self,
        workspace: str,
        kind: str,
        parameters: Mapping[str, Any],
        *,
        priority: int = 0,
        after: Sequence[Job | str] = (),
        key: str = "",
    ) -> Steps[Job]:
        """Submit a job of any kind: ``run``, ``import``, ``look``, …, with its parameters."""
        request = _request(workspace, JobKind(kind), parameters, priority, after, key)
        return (yield from self.place.submit(request))

    @call
    def forecast(
        self,
        /,
        workspace: str,
        stages: Sequence[str] = (),
        *,
        progress: bool = True,
        **parameters: Any,
    ) -> Steps[dict[str, Any]]:
        """Return time, memory and disk that each stage will take, before anything is run.

        Parameters
        ----------
        workspace : str
        stages : sequence of str
        progress : bool
        **parameters
            `settings` and `solution`, as of a run.
        """
        given = {"stages": list(stages), **parameters}
        result = yield from self._result(workspace, JobKind.FORECAST, given, shown=progress)
        return dict(result["forecast"])

    @call
    def use_solution(self, workspace: str, name: str) -> Steps[str]:
        """Let all commands read a solution from now on where none is named; return its name."""
        given = {"name": name}
        result = yield from self._result(workspace, JobKind.SOLUTION_USE, given, shown=False)
        return str(result["in_use"])

    @call
    def job(self, job: Job | str) -> Steps[Job]:
        """Return a job with its progress, and its result or error."""
        return (yield from self.place.job(_id(job)))

    @call
    def jobs(
        self, workspace: str = "", *, states: Sequence[JobState | str] = (), limit: int = 100
    ) -> Steps[list[Job]]:
        """Return jobs of a workspace or of all, the newest first."""
        return (yield from self.place.jobs(workspace, [JobState(one) for one in states], limit))

    @call
    def wait(
        self,
        job: Job | str,
        *,
        progress: bool = True,
        timeout_s: float | None = None,
        check: bool = True,
    ) -> Steps[Job]:
        """Return a job when it has ended; a server that starts again meanwhile is waited for.

        Parameters
        ----------
        job : Job or str
        progress : bool
            Show how far it is on standard error.
        timeout_s : float, optional
        check : bool
            Otherwise failed and cancelled jobs are returned, too.

        Raises
        ------
        TimeoutError
            If it has not ended in time; it goes on.
        SpcolaError
            If it failed, of the class that the command raises; `JobFailedError` where there is
            none, and if it was cancelled.
        """
        with job_bar(shown=progress) as show:
            ended = yield from self._ended(job, show, timeout_s)
        return _checked(ended) if check else ended

    @call
    def cancel(self, job: Job | str) -> Steps[Job]:
        """Cancel a job: at once while it waits; one that runs ends with its current items."""
        return (yield from self.place.cancel(_id(job)))

    @call
    def log(self, job: Job | str) -> Steps[list[dict[str, Any]]]:
        """Return the lines of a job's log, with `time` (seconds since 1970) and `text`."""
        return (yield from self.place.log(_id(job)))

    @stream
    def events(
        self, job: Job | str = "", *, workspace: str = "", after: int | None = None
    ) -> Emitting[Event]:
        """Iterate over events as they happen; a lost connection goes on after the last one.

        Parameters
        ----------
        job : Job or str
            All events of this job; the iteration ends with it. Without a job those of all jobs
            from now on.
        workspace : str
            Only those of its jobs.
        after : int, optional
            Number of the last event that is known.
        """
        identity = _id(job)
        # In between stands the end of the job: nothing more will come.
        source = self.place.events(identity, workspace, after)
        yield from _until_ended(source) if identity else source

    def _result(
        self, workspace: str, kind: JobKind, given: Mapping[str, Any], *, shown: bool
    ) -> Steps[dict[str, Any]]:
        """Return the result of a job that begins before others of the user."""
        job = yield from self.place.submit(_request(workspace, kind, given, _SOON))
        with job_bar(shown=shown) as show:
            ended = yield from self._ended(job, show, None)
        return dict(_checked(ended).result)

    def _ended(
        self, job: Job | str, show: Callable[[Job], None], timeout_s: float | None
    ) -> Steps[Job]:
        """Look at a job until it has ended."""
        begun, pause = time.monotonic(), _FIRST_LOOK_S
        while True:
            found = yield from self.place.job(_id(job))
            show(found)
            if found.state.ended:
                return found
            if timeout_s is not None and time.monotonic() - begun >= timeout_s:
                name = job_name(found)
                raise TimeoutError(f"{name} has not ended after {timeout_s:g} s; it goes on")
            yield Pause(pause)
            pause = min(1.5 * pause, _LOOK_S)


def _until_ended(source: Emitting[Event]) -> Emitting[Event]:
    """Pass events on up to the end of the job."""
    given: Any = None
    go_on: Callable[[Any], Any] = source.send
    while True:
        effect = go_on(given)
        go_on = source.send
        try:
            given = yield effect
        except Exception as error:
            go_on, given = source.throw, error
        value = getattr(effect, "value", None)
        if not isinstance(value, Event) or value.kind != "state":
            continue
        if JobState(value.content["state"]).ended:
            return


def _request(
    workspace: str,
    kind: JobKind,
    parameters: Mapping[str, Any],
    priority: int = 0,
    after: Sequence[Job | str] = (),
    key: str = "",
) -> JobRequest:
    before = tuple(_id(job) for job in after)
    # The user is known to the server by the token.
    return JobRequest(
        kind, workspace, "", parameters, priority, before, key or secrets.token_hex(16)
    )


def _id(job: Job | str) -> str:
    return job if isinstance(job, str) else job.id


def _checked(job: Job) -> Job:
    """Return a job that is finished; raise the error of another one."""
    if job.state is not JobState.FINISHED:
        raise failure(job)
    return job
