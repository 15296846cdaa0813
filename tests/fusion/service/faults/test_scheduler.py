"""A Dask scheduler that is lost: the job waits for it, and for its workers."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import pytest
from collector import Collector, collector
from damage import files_in
from dask_processes import DaskProcesses
from served import MAPLETS, Service
from server_process import wait_for

import fusion.runtime.cluster
from fusion.service.jobs import JobState
from fusion.service.store import Store
from fusion.service.tracing import COLLECTOR_VARIABLE, start_tracing


@pytest.fixture
def spans() -> Iterator[Collector]:
    pytest.importorskip("opentelemetry.sdk")
    with collector() as running:
        yield running


def test_a_job_waits_for_a_lost_scheduler_and_goes_on(
    missions: Path,
    by_command: tuple[Path, dict],
    spans: Collector,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fusion.runtime.cluster, "_ANSWER_S", 3)
    monkeypatch.setattr(fusion.runtime.cluster, "_LOOK_S", 0.5)
    items = missions / "ball" / ".items" / "mapolas"

    monkeypatch.setenv(COLLECTOR_VARIABLE, spans.url)
    with (
        DaskProcesses() as cluster,
        Store(missions / ".service" / "store.sqlite") as store,
        start_tracing("worker"),
    ):
        service = Service(missions, store)

        def work() -> None:
            time.sleep(0.1)
            service.work(cluster=cluster.address, cluster_wait_s=0.1)

        def lose_the_scheduler() -> None:
            wait_for(lambda: len(list(items.glob("[!.]*.npz"))) > 2)
            cluster.kill("scheduler")

        job = service.submit(stages=["mapolas"])
        cluster.start("scheduler")
        cluster.wait(0)
        work()
        cluster.start("worker")
        cluster.wait(1)
        losing = threading.Thread(target=lose_the_scheduler)
        losing.start()
        work()
        losing.join()
        assert store.job(job.id).state is JobState.WAITING
        work()
        cluster.kill("worker")
        cluster.start("scheduler")
        cluster.start("worker")
        cluster.wait(1)
        kept = {path.name: path.stat().st_ino for path in items.glob("[!.]*.npz")}
        work()
        done = store.job(job.id)
        # On a slow machine the wait ends before `work` returns, and the same is noted twice.
        noted = (str(one["text"]) for one in service.notes(job) if one.get("code"))
        notes = [text for text, _ in groupby(noted)]
    assert done.state is JobState.FINISHED, done.error
    for note, text in zip(notes, ("has no worker", "", "no Dask scheduler answers"), strict=True):
        assert text in note
    assert files_in(missions / "ball") == files_in(by_command[0])
    done_items = [one for one in spans.spans if one.name == "item" and not one.failed]
    stages = {one.id: one for one in spans.spans if one.name == "stage mapolas"}
    for one in done_items:
        stage = stages[one.parent]
        assert one.attributes["spcola.cluster_worker"].startswith("tcp://127.0.0.1:")
        assert stage.begun_ns - 1e6 <= one.begun_ns < one.ended_ns <= stage.ended_ns + 1e6
    named = {one.attributes["spcola.item"] for one in done_items}
    assert len([name for name in named if name.startswith("AA")]) == MAPLETS
    there = {path.name: path.stat().st_ino for path in items.glob("[!.]*.npz")}
    assert {name: there.get(name) for name in kept} == kept
