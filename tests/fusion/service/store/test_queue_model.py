"""The queue against a simple one in memory: any sequence of calls, clocks that are set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from fusion.service.jobs import JobError, JobKind, JobProgress, JobRequest, JobState
from fusion.service.store import Store, StoreError
from fusion.service.store.endings import LOSSES

WORKERS = st.sampled_from(["w1", "w2", "w3"])
LEASE_S = 10.0
EXAMPLES = 8


@dataclass
class ModelJob:
    request: JobRequest
    state: JobState
    tries: int = 0
    worker: str = ""
    cancelling: bool = False
    since: float = 0.0
    until: float = 0.0
    beat: int = 0
    kept: int = 0
    losses: int = 0
    seen: tuple[int, float] = (-1, 0.0)

    @property
    def place(self) -> tuple[str, Any]:
        return self.request.workspace, self.request.parameters.get("solution")


@dataclass
class Model:
    """The promises of `JobQueue`, in the shortest words."""

    jobs: dict[str, ModelJob] = field(default_factory=dict)
    turns: list[str] = field(default_factory=list)
    clock: float = 1e9
    monotonic: float = 50.0

    def running(self) -> list[ModelJob]:
        return [job for job in self.jobs.values() if job.state is JobState.RUNNING]

    def submit(self, identity: str, request: JobRequest) -> None:
        lost = any(self.jobs[one].state in LOST for one in request.after)
        self.jobs[identity] = ModelJob(request, JobState.FAILED if lost else JobState.WAITING)

    def end(self, identity: str, state: JobState) -> None:
        self.jobs[identity].state = state
        self.jobs[identity].cancelling = False
        if state in LOST:
            for other, job in self.jobs.items():
                if identity in job.request.after and job.state is JobState.WAITING:
                    self.end(other, JobState.FAILED)

    def wait_again(self, identity: str, wait_s: float) -> None:
        job = self.jobs[identity]
        if job.cancelling:
            self.end(identity, JobState.CANCELLED)
        else:
            job.state, job.since, job.until = JobState.WAITING, self.clock, self.clock + wait_s

    def lose(self, identity: str) -> None:
        job = self.jobs[identity]
        job.losses = 0 if job.kept else job.losses + 1
        if job.losses >= LOSSES and not job.cancelling:
            self.end(identity, JobState.FAILED)
        else:
            self.wait_again(identity, 0.0)

    def claim(self, worker: str) -> str | None:
        for identity, job in self.jobs.items():
            if job.state is JobState.RUNNING:
                if job.seen[0] != job.beat:
                    job.seen = (job.beat, self.monotonic)
                if self.monotonic - job.seen[1] >= LEASE_S:
                    self.lose(identity)
            else:
                job.seen = (-1, 0.0)
        ready = [(self._order(name), name) for name, job in self.jobs.items() if self._ready(job)]
        if not ready:
            return None
        identity = min(ready)[1]
        job = self.jobs[identity]
        self.turns.append(job.request.user)
        job.state, job.worker, job.kept = JobState.RUNNING, worker, 0
        job.tries += 1
        job.beat += 1
        return identity

    def _ready(self, job: ModelJob) -> bool:
        return (
            job.state is JobState.WAITING
            and all(self.jobs[one].state is JobState.FINISHED for one in job.request.after)
            and not job.since <= self.clock < job.until
            and job.place not in {other.place for other in self.running()}
        )

    def _order(self, identity: str) -> tuple[Any, ...]:
        request = self.jobs[identity].request
        busy = sum(job.request.user == request.user for job in self.running())
        turns = [number for number, user in enumerate(self.turns) if user == request.user]
        return busy, turns[-1] if turns else -1, -request.priority, identity


LOST = {JobState.FAILED, JobState.CANCELLED}


class QueueMachine(RuleBasedStateMachine):
    def __init__(self, store: Callable[[Model], Store]) -> None:
        super().__init__()
        self.model = Model()
        self.store = store(self.model)

    def teardown(self) -> None:
        self.store.close()

    @rule(
        user=st.sampled_from(["ada", "bea"]),
        workspace=st.sampled_from(["bennu", "eros"]),
        solution=st.sampled_from(["", "a"]),
        priority=st.integers(-1, 1),
        key=st.sampled_from(["", "", "k"]),
        data=st.data(),
    )
    def submit(self, user, workspace, solution, priority, key, data) -> None:
        known = sorted(self.model.jobs)
        after = ()
        if known:
            after = tuple(data.draw(st.lists(st.sampled_from(known), max_size=2, unique=True)))
        parameters = {"solution": solution}
        request = JobRequest(JobKind.RUN, workspace, user, parameters, priority, after, key)
        first = [
            (name, job.request)
            for name, job in self.model.jobs.items()
            if key and (job.request.key, job.request.user) == (key, user)
        ]
        if first and first[0][1] != request:
            assert_fault("key-reused", lambda: self.store.submit(request))
            return
        job = self.store.submit(request)
        if first:
            assert job.id == first[0][0]
        else:
            assert job.request == request
            assert job.id > max(self.model.jobs, default="")
            self.model.submit(job.id, request)

    @rule(worker=WORKERS)
    def claim(self, worker) -> None:
        job = self.store.claim(worker, LEASE_S)
        assert (job.id if job else None) == self.model.claim(worker)

    @rule(worker=WORKERS, done=st.integers(0, 3), kept=st.integers(0, 1), data=st.data())
    def renew(self, worker, done, kept, data) -> None:
        identity, job = self.some_job(data)
        progress = JobProgress("fuse", "maplets", done, 3, 1.0, kept)

        def call() -> None:
            assert self.store.renew(identity, worker, LEASE_S, progress) == job.cancelling
            job.beat += 1
            job.kept = kept
            assert self.store.job(identity).progress == progress

        self.leased(job, worker, call)

    @rule(
        worker=WORKERS,
        how=st.sampled_from(["finish", "fail", "give_back", "lost"]),
        data=st.data(),
    )
    def leave(self, worker, how, data) -> None:
        identity, job = self.some_job(data)
        if how == "lost":
            self.store.lost(worker)
            for name, mine in self.model.jobs.items():
                if mine.state is JobState.RUNNING and mine.worker == worker:
                    self.model.lose(name)
        elif how == "finish":
            if job.state is JobState.FINISHED and job.worker == worker:
                self.store.finish(identity, worker, {"again": 1})
                assert self.store.job(identity).result == {"n": 1}
                return

            def finish() -> None:
                self.store.finish(identity, worker, {"n": 1})
                job.losses = 0
                self.model.end(identity, JobState.FINISHED)

            self.leased(job, worker, finish)
        elif how == "fail":
            if job.state.ended and job.worker == worker:
                self.store.fail(identity, worker, JobError("x", "again"))
                return
            ending = JobState.CANCELLED if job.cancelling else JobState.FAILED

            def fail() -> None:
                self.store.fail(identity, worker, JobError("x", "is bad", "BE0001"))
                assert self.store.job(identity).error == JobError("x", "is bad", "BE0001")
                self.model.end(identity, ending)

            self.leased(job, worker, fail)
        else:

            def give_back() -> None:
                self.store.give_back(identity, worker, wait_s=30.0)
                self.model.wait_again(identity, 30.0)

            self.leased(job, worker, give_back)

    @rule(data=st.data())
    def cancel(self, data) -> None:
        identity, job = self.some_job(data)
        cancelled = self.store.cancel(identity)
        if job.state is JobState.WAITING:
            self.model.end(identity, JobState.CANCELLED)
        elif job.state is JobState.RUNNING:
            job.cancelling = True
        assert cancelled == self.store.job(identity)

    @rule(seconds=st.sampled_from([1.0, 4.0, 11.0]))
    def time_passes(self, seconds) -> None:
        self.model.clock += seconds
        self.model.monotonic += seconds

    @rule(seconds=st.sampled_from([-1e8, -20.0, 20.0, 1e8]))
    def the_clock_is_set(self, seconds) -> None:
        self.model.clock += seconds

    @invariant()
    def all_jobs_are_as_in_the_model(self) -> None:
        jobs = {job.id: job for job in self.store.jobs(limit=1000)}
        assert {name: (job.state, job.tries, job.cancelling) for name, job in jobs.items()} == {
            name: (job.state, job.tries, job.cancelling) for name, job in self.model.jobs.items()
        }
        assert list(jobs) == sorted(jobs, reverse=True)
        events = self.store.events()
        assert [one.number for one in events] == sorted({one.number for one in events})
        last = {one.job: one.content["state"] for one in events if one.kind == "state"}
        assert last == {name: job.state.value for name, job in self.model.jobs.items()}
        progress = [one.job for one in events if one.kind == "progress"]
        assert len(progress) == len(set(progress))

    def some_job(self, data: Any) -> tuple[str, ModelJob]:
        if not self.model.jobs:
            request = JobRequest(JobKind.RUN, "bennu", "ada", {"solution": ""})
            self.model.submit(self.store.submit(request).id, request)
        identity = data.draw(st.sampled_from(sorted(self.model.jobs)))
        return identity, self.model.jobs[identity]

    def leased(self, job: ModelJob, worker: str, call: Callable[[], None]) -> None:
        if job.state is JobState.RUNNING and job.worker == worker:
            call()
        else:
            assert_fault("lease-lost", call)


def assert_fault(code: str, call: Callable[[], Any]) -> None:
    with pytest.raises(StoreError) as caught:
        call()
    assert caught.value.code == code


def test_the_queue_does_what_the_model_does(new_url) -> None:
    def store(model: Model) -> Store:
        return Store(new_url(), clock=lambda: model.clock, monotonic=lambda: model.monotonic)

    run_state_machine_as_test(
        lambda: QueueMachine(store),
        settings=settings(
            max_examples=EXAMPLES,
            stateful_step_count=30,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
