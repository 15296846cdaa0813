"""Servers and workers that are killed, and a store that is damaged, in real processes."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from damage import files_in
from server_process import ASKING_S, ServerProcess, wait_for

JOBS = "/api/v1/workspaces/ball/jobs"


def test_what_is_killed_goes_on_and_a_damaged_store_is_made_again(
    serve: Callable[..., ServerProcess],
    missions: Path,
    by_command: tuple[Path, dict],
    tmp_path: Path,
) -> None:
    items = missions / "ball" / ".items" / "mapolas"

    def finished() -> dict[str, int]:
        return {path.name: path.stat().st_ino for path in items.glob("[!.]*.npz")}

    first = serve()
    with first.client() as client:
        run = {"kind": "run", "parameters": {"stages": ["mapolas"]}}
        job = client.post(JOBS, json=run).json()["id"]
    wait_for(finished)
    first.kill()
    kept = finished()
    # The worker of the killed server gives its job back; that of the next one is killed as well.
    second = serve()
    with second.client() as client:

        def job_now() -> dict:
            return client.get(f"/api/v1/jobs/{job}").json()

        wait_for(lambda: job_now()["state"] == "running", every=ASKING_S)
        second.kill_worker()
        wait_for(lambda: job_now()["state"] not in ("waiting", "running"), every=ASKING_S)
        done = job_now()
    assert done["state"] == "finished", done
    assert done["tries"] >= 2
    assert done["result"]["stages"][0]["summary"] == by_command[1]["summary"]
    assert files_in(missions / "ball") == files_in(by_command[0])
    assert {name: finished().get(name) for name in kept} == kept
    second.kill()

    store = missions / ".service" / "store.sqlite"
    # The killed server leaves newer pages in the write-ahead log: they would hide the damage.
    with closing(sqlite3.connect(store)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    content = store.read_bytes()
    store.write_bytes(content[:4096] + b"\x5a" * 8192 + content[12288:])
    errors = tmp_path / "errors"
    with errors.open("wb") as stream:
        third = serve(errors=stream)
    with third.client() as client:
        (recovered,) = client.get("/api/v1/jobs").json()["jobs"]
    assert (recovered["user"], recovered["state"]) == ("recovered", "finished")
    assert recovered["result"]["mapolas"] == done["result"]["stages"][0]["summary"]
    assert third.stop() == 0
    assert "was damaged" in errors.read_text().splitlines()[0]
