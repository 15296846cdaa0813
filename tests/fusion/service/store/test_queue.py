"""The queue with several processes, and users, and killed ones."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from itertools import chain, groupby

import pytest
import queue_processes

from fusion.service.jobs import JobKind, JobProgress, JobRequest, JobState
from fusion.service.store import Store, StoreError, UnknownJobError
from fusion.service.store.endings import LOSSES
from fusion.service.store.queue import MOST_NOTES


def run_processes(*arguments: str):
    command = [sys.executable, queue_processes.__file__, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    return json.loads(done.stdout)


def request(user: str, workspace: str, **more) -> JobRequest:
    return JobRequest(JobKind.RUN, workspace, user, **more)


def test_processes_that_claim_at_once_share_the_jobs(new_url) -> None:
    url = new_url()
    with Store(url) as store:
        jobs = [store.submit(request("ada", f"ws{n}")).id for n in range(45)]
        taken = run_processes("claim", url)
        assert sorted(chain(*taken)) == jobs
        assert sum(bool(mine) for mine in taken) > 1
        assert store.counts()[JobState.FINISHED] == len(jobs)


def test_users_share_the_workers(store: Store) -> None:
    for n in range(6):
        store.submit(request("many", f"m{n}", priority=50))
    for user in ("few", "one"):
        store.submit(request(user, user))
    # Every user has one running before anyone has two.
    first = [store.claim("w", 60.0).request.user for _ in range(4)]
    assert Counter(first[:3]) == {"many": 1, "few": 1, "one": 1}
    assert first[3] == "many"
    # With one worker users take turns, whatever they have waiting.
    for job in store.jobs():
        store.cancel(job.id)
        if job.state is JobState.RUNNING:
            store.give_back(job.id, "w")
    for _ in range(3):
        store.submit(request("many", "shared"))
        store.submit(request("few", "shared"))
    turns = []
    while (job := store.claim("w", 60.0)) is not None:
        turns.append(job.request.user)
        store.finish(job.id, "w", {})
    assert all(len(list(same)) == 1 for _, same in groupby(turns))


def test_a_kill_between_any_two_statements_leaves_a_consistent_queue(new_url) -> None:
    url = new_url()
    # Some of 234 places; with a step of 1 this took 20 s, and found nothing more.
    wrong = run_processes("kill", url, "13")
    assert len(wrong) > 15
    assert wrong == [[]] * len(wrong)


def test_a_lease_ends_by_a_clock_that_is_never_set(new_url) -> None:
    clock, monotonic = 1e9, 0.0
    with Store(new_url(), clock=lambda: clock, monotonic=lambda: monotonic) as store:
        job = store.submit(request("ada", "bennu"))
        store.claim("w", 60.0)
        for jump in (1e6, -3e6, 1e8):
            clock += jump
            assert store.claim("other", 60.0) is None
        monotonic += 59.0
        assert store.renew(job.id, "w", 60.0, JobProgress()) is False
        monotonic += 59.0
        assert store.claim("other", 60.0) is None  # the renewal is seen here
        monotonic += 60.0
        assert store.claim("other", 60.0).id == job.id
        with pytest.raises(StoreError, match="no longer belongs to the worker 'w'"):
            store.finish(job.id, "w", {})
        # Each further worker is lost: the job ends, and says why.
        for _ in range(5):
            store.claim("x", 60.0)
            monotonic += 61.0
        assert store.job(job.id).error.code == "workers-lost"


def test_only_what_is_finished_lets_a_job_lose_its_workers_again_and_again(store: Store) -> None:
    job = store.submit(request("ada", "bennu"))
    turns = 0
    while (claimed := store.claim(f"w{turns}", 60.0)) is not None:
        # For hours, and with items that the next worker has to do again.
        for n in range(50):
            progress = JobProgress("fuse", "maplets", n, 900, kept=n if turns < 5 else 0)
            store.renew(job.id, f"w{turns}", 60.0, progress)
        store.lost(f"w{turns}")
        turns += 1
        assert claimed.tries == turns < 20
    assert turns == 5 + LOSSES
    error = store.job(job.id).error
    assert error.code == "workers-lost"
    assert "the last one on fuse: maplets, 49 of 900" in error.text


def test_a_wait_ends_when_the_clock_is_set_back(new_url) -> None:
    clock = 1e9
    with Store(new_url(), clock=lambda: clock) as store:
        job = store.submit(request("ada", "bennu"))
        store.claim("w", 60.0)
        store.give_back(job.id, "w", wait_s=300.0)
        assert store.claim("w", 60.0) is None
        clock -= 1e7
        assert store.claim("w", 60.0).id == job.id
        # Event numbers grow, whatever the clock does.
        numbers = [one.number for one in store.events()]
        assert numbers == sorted(set(numbers))


def test_requests_that_cannot_be_jobs(store: Store) -> None:
    with pytest.raises(UnknownJobError, match="no such job"):
        store.submit(request("ada", "bennu", after=("00000001-0000",)))
    with pytest.raises(Exception, match="101 is not between"):
        store.submit(request("ada", "bennu", priority=101))
    with pytest.raises(Exception, match="JSON"):
        store.submit(request("ada", "bennu", parameters={"x": {1, 2}}))
    for name in ("", "x", "00000001-zz", "9" * 400):
        with pytest.raises(UnknownJobError):
            store.job(name)
    assert store.jobs() == []


def test_the_log_of_a_job_is_bounded(store: Store) -> None:
    job = store.submit(request("ada", "bennu"))
    with store._database.writing() as connection:
        connection.exec_driver_sql(f"UPDATE job SET notes = {MOST_NOTES - 1}")
    for _ in range(3):
        store.note(job.id, "x" * 5000, {"item": "BE0001"})
    notes = [one.content for one in store.events(job=job.id) if one.kind == "note"]
    assert [len(note["text"]) for note in notes] == [4000, len("further lines are left out")]


def test_pages_of_jobs(store: Store) -> None:
    jobs = [store.submit(request(f"u{n % 2}", f"w{n % 3}")).id for n in range(7)]
    first = store.jobs(limit=3)
    second = store.jobs(limit=3, before=first[-1].id)
    assert [job.id for job in first + second] == jobs[:0:-1]
    assert [job.id for job in store.jobs(workspaces=["w0"], user="u0")] == [jobs[6], jobs[0]]
    assert store.jobs(workspaces=[]) == []
    assert store.jobs(states=[JobState.RUNNING]) == []
