"""What is recorded as done is on the disk: the order of all writes, seen from outside."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import power_cut
import pytest
from command_line import ROOT

# Two worker processes and the server write; here they are one, so that the order is one.
PROGRAM = """
import sys
from hashlib import sha256
from pathlib import Path
from asgi_client import AsgiClient
from served import Service as Served
from fusion.service.api import Service, create_app
from fusion.service.store import Store
root, content = Path(sys.argv[1]), bytes(1000)
with Store(root / ".service" / "store.sqlite") as store:
    with AsgiClient(create_app(Service(root, store))) as client:
        new = {"name": "a.las", "size": 1000, "sha256": sha256(content).hexdigest(), "kind": "scan"}
        place = client.post("/api/v1/workspaces/ball/uploads", json=new).headers["location"]
        head = {"Upload-Offset": "0", "Content-Type": "application/octet-stream"}
        assert client.patch(place, content=content, headers=head).status_code == 204
        assert client.post(f"{place}/complete").json()["state"] == "complete"
    served = Served(root, store)
    job = served.submit(stages=["mapolas"])
    served.work()
    assert store.job(job.id).state == "finished"
"""
FINISHED = r"\"state\":\"finished\""


def test_nothing_that_is_recorded_is_lost_by_a_power_cut(ball: Path, tmp_path: Path) -> None:
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed; on Debian: apt-get install strace")
    root, trace = tmp_path / "missions", tmp_path / "trace"
    shutil.copytree(ball, root / "ball")
    watch = ["strace", "-f", "--seccomp-bpf", "-y", "-s", "5000", "-e", power_cut.CALLS]
    command = [*watch, "-o", trace, sys.executable, "-c", PROGRAM, root]
    paths = f"{ROOT}:{ROOT / 'tests' / 'helpers'}"
    subprocess.run(
        command, check=True, stdout=subprocess.DEVNULL, env={"PYTHONPATH": paths, "PATH": "/bin"}
    )
    disk, recorded = power_cut.Disk(), []
    wanted = [root / "ball", root / ".service" / "uploads"]
    for call, rest in power_cut.operations(trace):
        if call == "pwrite64" and "store.sqlite-wal>" in rest and FINISHED in rest:
            recorded.append(disk.missing(wanted))
        disk.do(call, rest)
    assert [one for one in disk.torn if one.startswith(str(root))] == []
    # Once as the event, and again with whatever shares its page.
    assert recorded
    assert recorded[0] == []
