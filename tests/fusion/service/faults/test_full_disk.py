"""A disk that is really full: jobs stop, the server goes on, and all goes on when there is room."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from asgi_client import AsgiClient
from damage import files_in
from served import Service as Served

from fusion.service.api import Service, create_app
from fusion.service.jobs import JobState
from fusion.service.store import Store

SIZE = "48m"


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A small file system of its own."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", place]
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("a file system can be mounted by root only")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


def fill(disk: Path, left: int) -> Path:
    """Fill a disk but for some bytes; return the file to remove."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as stream:
        block = bytes(1 << 16)
        while shutil.disk_usage(disk).free > left:
            stream.write(block[: shutil.disk_usage(disk).free - left])
    return filler


def test_jobs_stop_on_a_full_disk_and_go_on_when_there_is_room(
    ball: Path, disk: Path, by_command: tuple[Path, dict]
) -> None:
    shutil.copytree(ball, disk / "ball")
    with Store(disk / ".service" / "store.sqlite") as store:
        served = Served(disk, store)
        with AsgiClient(create_app(Service(disk, store))) as client:
            job = served.submit(stages=["mapolas"])
            # Some items have room; then neither they nor the store have.
            filler = fill(disk, 600_000)
            # A long lease: where the machine is slow, its renewals would fill the room for items.
            served.work(disk_wait_s=0.2, lease_s=30.0, renew_s=10.0)
            assert shutil.disk_usage(disk).free < 600_000
            kept = {path.name: path.stat().st_ino for path in disk.glob("ball/.items/*/[!.]*.npz")}
            assert kept
            fill(disk, 0)
            served.work(disk_wait_s=0.2, lease_s=0.6)
            assert not store.job(job.id).state.ended
            assert client.get("/health").status_code == 200
            assert client.get("/api/v1/jobs").json()["jobs"][0]["id"] == job.id
            assert client.get("/api/v1/workspaces/ball").status_code == 200
            new = {"name": "a.las", "size": 10, "sha256": "0" * 64, "kind": "scan"}
            large = {"parameters": {"stages": ["mapolas"], "only": ["x" * 900] * 400}}
            for what, body in (("uploads", new), ("jobs", large)):
                refused = client.post(f"/api/v1/workspaces/ball/{what}", json=body)
                assert (refused.status_code, refused.json()["code"]) == (507, "disk-full")
            filler.unlink()
            until = time.monotonic() + 60
            while not store.job(job.id).state.ended and time.monotonic() < until:
                time.sleep(0.2)
                served.work(disk_wait_s=0.2, lease_s=0.6)
            done = store.job(job.id)
            assert done.state is JobState.FINISHED, done.error
            assert files_in(disk / "ball") == files_in(by_command[0])
            there = {path.name: path.stat().st_ino for path in disk.glob("ball/.items/*/[!.]*.npz")}
            assert {name: there.get(name) for name in kept} == kept
            # Nothing of what was refused is there.
            assert len(store.jobs()) == 1
