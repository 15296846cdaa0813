"""``spcola spc lithos`` on a cluster: the same bytes as on one thread, also after interruptions."""

from __future__ import annotations

import shutil
import signal
import time

import pytest
from command_line import call, called, program
from distributed import LocalCluster

from fusion.workspace import Workspace

SOME = ("TR0006", "TR0009", "TR0010", "TR0012")
RUN = (
    *(part for name in SOME for part in ("--only", name)),
    *(part for kind in ("overlaps", "returns", "shape") for part in ("--constraint", kind)),
    "--rounds", "3", "--as", "images",
)  # fmt: skip


@pytest.fixture(scope="module")
def address():
    """The scheduler of a cluster of two processes."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield str(cluster.scheduler_address)


def copied(imaged_mission, target):
    """A copy of the mission in which nothing was solved."""
    left_out = shutil.ignore_patterns("solutions", ".items")
    return shutil.copytree(imaged_mission[0], target, symlinks=True, ignore=left_out)


def made(root):
    """All files of the new solution, without the times in its record."""
    folder = root / "solutions" / "images"
    files = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "solution.json"
    }
    ends = (".MAP", ".ASG", ".SSG", ".SDR")
    assert {f"MAPFILES/{name}{end}" for name in SOME for end in ends} <= set(files)
    return files


def items(root):
    """The inodes of the files of finished maplets: a file that is written anew has another."""
    folder = root / ".items" / "lithos"
    found = folder.glob("*.npz") if folder.is_dir() else ()
    return {path.name: path.stat().st_ino for path in found}


@pytest.fixture(scope="module")
def alone(imaged_mission, tmp_path_factory):
    """The files that one thread makes, and what the command prints."""
    root = copied(imaged_mission, tmp_path_factory.mktemp("alone") / "WS")
    content = called("spc", "lithos", root, *RUN, "--workers", "1")
    assert len(items(root)) == len(SOME)
    return made(root), content


def test_a_cluster_makes_the_same_bytes(imaged_mission, alone, address, tmp_path, monkeypatch):
    root = copied(imaged_mission, tmp_path / "WS")
    # A path that means nothing in the folder of the workers.
    monkeypatch.chdir(tmp_path)
    content = called("spc", "lithos", "WS", *RUN, "--cluster", address)
    assert made(root) == alone[0]
    assert content["maplets"] == alone[1]["maplets"]
    assert content["images"] == alone[1]["images"]
    assert set(content["outcomes"]) <= {"converged", "not-converged"}


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_goes_on_where_it_was(imaged_mission, alone, address, tmp_path, how):
    root = copied(imaged_mission, tmp_path / "WS")
    run = program("spc", "lithos", root, *RUN, "--cluster", address)
    while not (before := items(root)) and run.poll() is None:
        time.sleep(0.01)
    run.send_signal(how)
    _, error = run.communicate()
    assert 1 <= len(before) < len(SOME)
    assert run.returncode != 0
    assert not (root / "solutions" / "images").exists()
    assert how == signal.SIGKILL or error.splitlines()[-1].startswith("interrupted")
    assert Workspace.open(root).solution == "imported"
    call("spc", "lithos", root, *RUN, "--cluster", address)
    assert made(root) == alone[0]
    after = items(root)
    assert len(after) == len(SOME)
    assert {name: after[name] for name in before} == before
