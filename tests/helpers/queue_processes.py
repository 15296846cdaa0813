"""Processes that use a store at once, or are killed in it. Arguments: WHAT URL [STEP]."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from multiprocessing import get_context
from multiprocessing.synchronize import Barrier

from sqlalchemy import event

from fusion.service.jobs import JobError, JobKind, JobProgress, JobRequest, JobState
from fusion.service.store import AuditEntry, Scope, Store

LEASE_S = 60.0


def forked(work: Callable[[], object]) -> tuple[int, int]:
    """Start a process that works and writes JSON; return its number and where to read that."""
    reader, writer = os.pipe()
    process = os.fork()
    if process == 0:
        with os.fdopen(writer, "w") as out:
            json.dump(work(), out)
            out.flush()
            os._exit(0)
    os.close(writer)
    return process, reader


def answer(process: int, reader: int) -> object:
    with os.fdopen(reader) as source:
        content = source.read()
    os.waitpid(process, 0)
    return json.loads(content) if content else None


def claim_all(url: str, ready: Barrier) -> list[str]:
    with Store(url) as store:
        mine = []
        ready.wait(60)
        while (job := store.claim(f"worker {os.getpid()}", LEASE_S)) is not None:
            mine.append(job.id)
            store.renew(job.id, f"worker {os.getpid()}", LEASE_S, JobProgress("x", "y", 1, 2))
            store.finish(job.id, f"worker {os.getpid()}", {})
    return mine


def use_everything(url: str, kill_at: int) -> int:
    """Use a store; be killed at a statement or commit; return how many there were otherwise."""
    passed = 0

    def passing(*_: object) -> None:
        nonlocal passed
        passed += 1
        if passed == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)

    store = Store(url)
    engine = store._database.engine
    for moment in ("before_cursor_execute", "after_cursor_execute", "commit"):
        event.listen(engine, moment, passing)
    first = store.submit(JobRequest(JobKind.IMPORT, "bennu", "ada", {"uploads": ["a"]}))
    second = store.submit(JobRequest(JobKind.RUN, "bennu", "ada", after=(first.id,), key=first.id))
    store.submit(JobRequest(JobKind.RUN, "bennu", "bea", after=(second.id,)))
    store.claim("w", LEASE_S)
    store.renew(first.id, "w", LEASE_S, JobProgress("ingest", "files", 1, 2))
    store.renew(first.id, "w", LEASE_S, JobProgress("ingest", "files", 2, 2))
    store.note(first.id, "a line")
    store.finish(first.id, "w", {"ingest": {"scans": 2}})
    store.claim("w", LEASE_S)
    store.give_back(second.id, "w")
    store.claim("w", LEASE_S)
    store.fail(second.id, "w", JobError("x", "is bad"))
    secret, token = store.tokens.make("ada", {"bennu": Scope.RUN})
    store.tokens.check(secret)
    store.tokens.revoke(token.id)
    store.audit.add(AuditEntry("ada", "submit", "bennu", first.id))
    return passed


def killed_in_between(url: str, step: int) -> Iterator[list[str]]:
    """Kill processes at one statement after the other; yield what each left as errors."""
    with Store(url) as store:
        for place in count(1, step):
            outcome = answer(*forked(partial(use_everything, url, place)))
            yield inconsistent(store)
            if outcome is not None:
                return


def inconsistent(store: Store) -> list[str]:
    """Return what contradicts the promises of the queue; then finish all jobs."""
    jobs = {job.id: job for job in store.jobs(limit=10_000)}
    wrong = [] if len(store.jobs(states=[JobState.RUNNING])) <= 1 else ["two run on a workspace"]
    for job in jobs.values():
        before = [jobs[one].state for one in job.request.after]
        if job.state is JobState.RUNNING and set(before) - {JobState.FINISHED}:
            wrong.append(f"{job.id} runs before {job.request.after}")
        if {JobState.FAILED, JobState.CANCELLED} & set(before) and job.state is not JobState.FAILED:
            wrong.append(f"{job.id} is {job.state} after a failed one")
        if (job.state is JobState.FINISHED) != bool(job.result):
            wrong.append(f"{job.id} is {job.state} with the result {job.result}")
        last = [one for one in store.events(job=job.id) if one.kind == "state"][-1]
        if last.content["state"] != job.state:
            wrong.append(f"{job.id} is {job.state}, its last event {last.content}")
    store.lost("w")
    while (job := store.claim("next", LEASE_S)) is not None:
        store.finish(job.id, "next", {"done": 1})
    wrong += [f"{job.id} cannot begin" for job in store.jobs(limit=10_000) if not job.state.ended]
    return wrong


if __name__ == "__main__":
    what, url, *more = sys.argv[1:]
    if what == "claim":
        ready = get_context("fork").Barrier(3)
        workers = [forked(partial(claim_all, url, ready)) for _ in range(3)]
        found = [answer(*worker) for worker in workers]
    else:
        found = list(killed_in_between(url, int(more[0])))
    sys.stdout.write(json.dumps(found))
