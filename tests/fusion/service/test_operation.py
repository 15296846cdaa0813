"""What an operator sees of a real server: spans, logs, metrics, and errors of one line."""

from __future__ import annotations

import json
import re
import shutil
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from collector import Collector, collector
from command_line import ROOT, called, refused
from served import MAPLETS
from server_process import ASKING_S, ServerProcess, wait_for


@pytest.fixture
def folder(ball: Path, tmp_path: Path) -> Path:
    shutil.copytree(ball, tmp_path / "missions" / "ball")
    return tmp_path / "missions"


@pytest.fixture
def spans() -> Iterator[Collector]:
    pytest.importorskip("opentelemetry.sdk")
    with collector() as running:
        yield running


def lines_of(folder: Path, names: str = "*") -> list[dict]:
    files = (folder / ".service" / "logs").glob(f"{names}.jsonl")
    return [json.loads(line) for file in files for line in file.read_text().splitlines()]


def test_spans_logs_and_metrics_of_a_run(
    folder: Path, spans: Collector, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPCOLA_LOG_LEVEL", "debug")
    server = ServerProcess(folder, "--telemetry", spans.url)
    asked = "0af7651916cd43dd8448eb211c80319c"
    try:
        with server.client() as client:
            job = client.post(
                "/api/v1/workspaces/ball/jobs",
                json={"kind": "run", "parameters": {"stages": ["mapolas"]}},
                headers={"traceparent": f"00-{asked}-b7ad6b7169203331-01"},
            ).json()["id"]
            wait_for(
                lambda: client.get(f"/api/v1/jobs/{job}").json()["state"] == "finished",
                every=ASKING_S,
            )
            wait_for(
                lambda: client.get("/ready").json()["checks"]["workers"] == "ok", every=ASKING_S
            )
            called("serve", "backup", folder, folder / "store.sqlite")
            # Events are looked for a few times a second.
            wait_for(
                lambda: "spcola_jobs_ended_total{" in client.get("/metrics").text, every=ASKING_S
            )
            metrics = client.get("/metrics").text
    finally:
        assert server.stop() == 0
    found = {one.name: one for one in spans.spans}
    (run,) = [one for one in spans.spans if one.name == "job run"]
    stage = found["stage mapolas"]
    items = [one for one in spans.spans if one.name == "item" and one.parent == stage.id]
    assert stage.parent == run.id
    assert {one.trace for one in (run, stage, *items)} == {run.trace}
    maplets = [one for one in items if one.attributes["spcola.item"].startswith("AA")]
    assert len({one.attributes["spcola.item"] for one in maplets}) == len(maplets) == MAPLETS
    assert all(one.attributes["spcola.job"] == job for one in (run, stage, *items))
    assert run.attributes["spcola.outcome"] == "finished"
    for one in items:
        assert stage.begun_ns - 1e6 <= one.begun_ns <= one.ended_ns <= stage.ended_ns + 1e6
    # A request is part of the trace of who asks.
    request = found["POST /api/v1/workspaces/{workspace}/jobs"]
    assert (request.trace, request.attributes["spcola.status"]) == (asked, 202)
    assert request.process == "server" != run.process
    assert not any(one.failed for one in spans.spans)

    logged = [line for line in lines_of(folder) if line["event"] == "item"]
    assert len([line for line in logged if line["stage"] == "mapolas"]) == len(items)
    assert all(line["job"] == job and line["item"] for line in logged)
    (begun,) = [line for line in lines_of(folder) if line.get("text") == "mapolas begins"]
    assert (begun["stage"], begun["job"], begun["workspace"]) == ("mapolas", job, "ball")

    assert stat.S_IMODE((folder / ".service").stat().st_mode) == 0o700
    values = dict(re.findall(r"^(spcola_\S+) (\S+)$", metrics, re.M))
    for name, value in {
        'spcola_jobs_ended_total{outcome="finished"}': 1,
        'spcola_jobs{state="finished"}': 1,
        'spcola_oldest_job_seconds{state="waiting"}': 0,
        'spcola_workers{state="wanted"}': 1,
        'spcola_workers{state="running"}': 1,
        "spcola_workers_ended_total": 0,
        "spcola_store_up": 1,
        "spcola_uploads_bytes": 0,
    }.items():
        assert float(values[name]) == value, name
    assert float(values["spcola_disk_free_bytes"]) > 0
    assert float(values["spcola_last_backup_timestamp_seconds"]) > 1e9
    assert float(values["spcola_last_cleaning_timestamp_seconds"]) > 1e9
    assert "process_resident_memory_bytes" in metrics


def test_without_a_collector_nothing_of_it_is_imported() -> None:
    program = (
        "import sys; from fusion.service import api, tracing; import fusion.service.work.process\n"
        "with tracing.start_tracing('x'): assert tracing.begin_span('a', {}) is None\n"
        # FastAPI itself imports the interface, which does nothing.
        "heavy = ('opentelemetry.sdk', 'opentelemetry.exporter', 'google.protobuf')\n"
        "assert not [name for name in sys.modules if name.startswith(heavy)]"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_a_collector_that_is_gone_costs_spans_only(folder: Path) -> None:
    pytest.importorskip("opentelemetry.sdk")
    server = ServerProcess(folder, "--workers", "0", "--telemetry", "http://127.0.0.1:1")
    with server.client() as client:
        assert client.get("/health").status_code == 200
    assert server.stop() == 0
    events = [line["event"] for line in lines_of(folder, "server")]
    assert "drained" in events
    assert events[-1].startswith("Failed to export spans")


def test_what_cannot_be_started_is_said_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def line(*options: object) -> str:
        return refused("serve", folder, "--port", 0, *options)

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert "stop what uses it" in refused("serve", folder, "--port", port)
    assert "check --host" in line("--host", "203.0.113.9")
    assert "is no name of a host" in line("--name", "http://spc.example/")
    assert "is no URL of a collector" in line("--telemetry", "localhost:4318")
    assert "check that PostgreSQL runs" in line("--store", "postgresql://u:word@127.0.0.1:1/none")
    assert "word" not in line("--store", "postgresql://u:word@127.0.0.1:1/none")
    assert "give a folder" in refused("serve", folder / "ball" / "spcola.toml")
    monkeypatch.setenv("SPCOLA_LOG_LEVEL", "loud")
    assert "SPCOLA_LOG_LEVEL: 'loud' is none of" in line()
