"""Two runs at a time, interrupts, and full disks."""

from __future__ import annotations

import fcntl
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from command_line import ROOT, call, program
from damage import (
    files_in,
    refused,
    states,
)

MAP, SUM, SHAPE = "MAPFILES/TR0003.MAP", "SUMFILES/P03I02.SUM", "SHAPEFILES/SHAPE.TXT"


def test_the_second_of_two_runs_is_refused(workspace: Path) -> None:
    with (workspace / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another spcola is at work here" in refused(workspace, "run")
        call("info", workspace)
    assert set(states(workspace).values()) == {"up to date"}


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    """Wait until `path` is there while `process` runs."""
    until = time.monotonic() + 60
    while not path.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    assert path.exists(), process.communicate()


def test_a_run_that_is_interrupted_and_killed_can_be_finished(
    workspace: Path, finished: Path
) -> None:
    shutil.rmtree(workspace / "fused")
    before = files_in(workspace)
    # A job in the background of a shell would hand down that interrupts are ignored.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    for how in (signal.SIGINT, signal.SIGKILL):
        for name in ("fused", ".scratch"):
            shutil.rmtree(workspace / name, ignore_errors=True)
        with program("run", workspace, "--workers", "1", preexec_fn=heed) as process:
            wait_for(workspace / ".scratch" / "fuse", process)
            wait_for(workspace / "fused", process)
            time.sleep(0.3)
            process.send_signal(how)
            out, err = process.communicate(timeout=60)
        assert out == ""
        assert process.returncode == (130 if how == signal.SIGINT else -how)
        if how == signal.SIGINT:
            assert err.splitlines()[-1].startswith("interrupted: ")
        now = files_in(workspace)
        assert {name: now[name] for name in before} == before
        assert all(Path(name).parts[1].startswith(".") for name in now.keys() - before.keys())
    assert states(workspace)["fuse"] == "ran"
    assert files_in(workspace).keys() == files_in(finished).keys()
    assert (workspace / "fused/TR0003.MAP").read_bytes() == (
        finished / "fused/TR0003.MAP"
    ).read_bytes()


def limited() -> None:
    """Let no file grow beyond 400 kB: what a full disk does, without one."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))


@pytest.mark.parametrize(("stage", "place"), [("mapolas", "mapolas"), ("release", "fused.h5")])
def test_a_full_disk_leaves_what_was_there(workspace: Path, stage: str, place: str) -> None:
    before = files_in(workspace)
    command = [stage, workspace, "--force"]
    with program(*command, preexec_fn=limited) as process:
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (1, ""), err
    lines = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert place in lines[0]
    assert "unexpected" not in err
    assert files_in(workspace) == before


@pytest.mark.parametrize(
    ("json_mode", "buffering"), [([], {}), (["--json"], {"PYTHONUNBUFFERED": "1"})]
)
def test_a_full_disk_under_standard_output_is_one_line(
    workspace: Path, json_mode: list[str], buffering: dict[str, str]
) -> None:
    command = [sys.executable, "-m", "fusion.cli", "info", str(workspace), *json_mode]
    # With and without a buffer between the program and the disk.
    buffered = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=ROOT,
            env={**buffered, **buffering},
        )
    assert done.returncode == 1
    assert done.stderr == "error: standard output: cannot be written (No space left on device)\n"


def test_help_comes_without_the_machinery() -> None:
    """Half a second of imports before every help text would be felt; a clock would not be fair."""
    script = (
        "import sys; from fusion.cli.app import command_line; command_line();"
        "print([m for m in ('numpy', 'scipy', 'numba', 'h5py', 'open3d') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout == "[]\n"


def test_it_runs_from_anywhere_and_in_a_pipe(workspace: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "fusion.cli", "info", f"../{workspace.name}", "--json"],
        capture_output=True,
        text=True,
        check=True,
        cwd=workspace / "scans" / "..",
        env=environment,
    )
    assert json.loads(done.stdout)["maplets"] == 24
    assert done.stderr == ""
