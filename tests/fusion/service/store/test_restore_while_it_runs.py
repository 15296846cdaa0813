"""Backup and restore of either kind of store while a server and its workers use it."""

from __future__ import annotations

import shutil
from pathlib import Path

from command_line import called
from damage import files_in
from server_process import ASKING_S, ServerProcess, wait_for

RUN = {"kind": "run", "parameters": {"stages": ["mapolas"]}}


def test_jobs_survive_a_restore(
    ball: Path, new_url, by_command: tuple[Path, dict], tmp_path: Path, monkeypatch
) -> None:
    missions = tmp_path / "missions"
    shutil.copytree(ball, missions / "ball")
    monkeypatch.setenv("SPCOLA_STORE", new_url())
    server = ServerProcess(missions)
    try:
        with server.client() as client:

            def state(job: str) -> str:
                return client.get(f"/api/v1/jobs/{job}").json().get("state", "unknown")

            def submit() -> str:
                return client.post("/api/v1/workspaces/ball/jobs", json=RUN).json()["id"]

            first, second = submit(), submit()
            wait_for(lambda: state(first) == "running", every=ASKING_S)
            called("serve", "backup", missions, tmp_path / "backup.sqlite")
            after = submit()
            # The worker goes on with the job that the backup has as running; what was submitted
            # later is forgotten.
            called("serve", "restore", missions, tmp_path / "backup.sqlite")
            assert state(after) == "unknown"
            wait_for(lambda: {state(first), state(second)} == {"finished"}, 120, every=ASKING_S)
            actions = [one["action"] for one in client.get("/api/v1/audit").json()["entries"]]
            assert "store-restored" in actions
    finally:
        assert server.stop() == 0
    assert files_in(missions / "ball") == files_in(by_command[0])
