"""Jobs do what commands do, and go on where a worker was stopped."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import resource
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import called
from damage import TINY, files_in
from served import MAPLETS, OPTIONS, Service
from server_process import wait_for

import fusion.runtime.cluster
from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from fusion.runtime.children import ProcessExecutor
from fusion.runtime.processes import ProcessLimits
from fusion.service.jobs import Job, JobKind, JobRequest, JobState
from fusion.service.work import Places, Supervisor, worker_command
from fusion.service.work.kinds import Assignment, perform_job
from fusion.service.work.report import JobReport
from fusion.truth import make_mission
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.solution_records import derived_names
from spcola.errors import WorkspaceError

Items = Callable[[], dict[str, int]]
OCTAHEDRON = """v 0.06 0 0\nv 0 0.06 0\nv -0.06 0 0\nv 0 -0.06 0\nv 0 0 0.06\nv 0 0 -0.06
f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 2 1 6\nf 3 2 6\nf 4 3 6\nf 1 4 6\n"""
UNMOVED = {
    "model": "similarity", "scale": 1.0, "rotation_deg": [0, 0, 0], "translation_m": [0, 0, 0],
    "per_scan": [], "per_mapola": [],
}  # fmt: skip


def check_same(service: Service, job: Job, by_command: tuple[Path, dict]) -> None:
    """Assert that a job made the files of the command, and has its output as result."""
    done = service.store.job(job.id)
    assert done.state is JobState.FINISHED, done.error
    assert files_in(service.workspace) == files_in(by_command[0])
    made = json.loads(json.dumps(done.result["stages"][0]))
    assert made["summary"] == by_command[1]["summary"]


@contextmanager
def as_soon_as(
    ready: Callable[[], object], act: Callable[[], object], seconds: float = 60.0
) -> Iterator[None]:
    """Act from a thread once something is there."""

    def watch() -> None:
        wait_for(ready, seconds)
        act()

    thread = threading.Thread(target=watch)
    thread.start()
    yield
    thread.join()


@pytest.mark.parametrize("how", ["cancelled", "drained"])
def test_a_stopped_job_keeps_its_items_and_goes_on_there(
    service: Service, items: Items, by_command: tuple[Path, dict], how: str
) -> None:
    job = service.submit(stages=["mapolas"])

    def stop() -> None:
        if how == "drained":
            os.kill(os.getpid(), signal.SIGTERM)
        else:
            service.store.cancel(job.id)

    with as_soon_as(items, stop):
        service.work(threads=1)
    found = service.store.job(job.id)
    assert found.state is (JobState.CANCELLED if how == "cancelled" else JobState.WAITING)
    kept = items()
    assert 0 < len(kept) < MAPLETS
    if how == "cancelled":
        return
    service.work()
    check_same(service, job, by_command)
    assert {name: items()[name] for name in kept} == kept


def cancelled_at(service: Service, job: Job, made: Callable[[], set[str]]) -> set[str]:
    """Cancel a job once it has made a file; return the files that it leaves."""
    with as_soon_as(made, partial(service.store.cancel, job.id)):
        service.work(threads=1)
    assert service.store.job(job.id).state is JobState.CANCELLED
    assert not [*service.folder.rglob("*.part")]
    return made()


def test_a_cancelled_import_keeps_its_scans_and_the_next_brings_the_others(
    service: Service,
) -> None:
    rng = np.random.default_rng(5)

    def table() -> bytes:
        points = rng.normal([60.0, 0.0, 0.0], 1.0, (4000, 3)).round(4)
        return "\n".join(["x,y,z", *(",".join(map(str, one)) for one in points)]).encode()

    names = {f"t{number:02d}" for number in range(12)}
    uploads = [service.upload(f"{name}.csv", table()) for name in sorted(names)]
    given = {"uploads": uploads, "columns": {axis: f"{axis} [m]" for axis in "xyz"}}

    def scans() -> set[str]:
        return {path.stem for path in (service.workspace / "scans").glob("t*.h5")}

    kept = cancelled_at(service, service.submit(JobKind.IMPORT, **given), scans)
    assert 0 < len(kept) < len(names)
    inodes = {name: (service.workspace / "scans" / f"{name}.h5").stat().st_ino for name in kept}
    again = service.submit(JobKind.IMPORT, **given)
    service.work(threads=1)
    done = service.store.job(again.id)
    assert done.state is JobState.FINISHED, done.error
    assert scans() == names
    assert {one["scan"] for one in done.result["scans"]} == names
    for name, inode in inodes.items():
        assert (service.workspace / "scans" / f"{name}.h5").stat().st_ino == inode


@pytest.mark.slow
def test_cancelled_bigmaps_are_made_to_the_bit_by_the_next_job(
    service: Service, by_command: tuple[Path, dict]
) -> None:
    root = service.workspace
    shutil.rmtree(root)
    shutil.copytree(by_command[0], root)
    (root / "SHAPEFILES" / "SHAPE.OBJ").write_text(OCTAHEDRON)
    (root / "registration.json").write_text(json.dumps(UNMOVED))
    maplet = Workspace.open(root).maplet("AA0010")
    source = np.full(maplet.grid.shape, int(Source.BOTH))
    sigma = np.full(maplet.grid.shape, 0.02)
    fused = FusedMaplet(
        "AA0010", maplet.grid, maplet.height, sigma=sigma, count=source, source=source
    )
    write_fused(root / "fused", [fused])
    sites = [
        {
            "name": f"S{number:02d}",
            "latitude_deg": 0.0,
            "longitude_deg": 0.1 * number,
            "size_m": 10.0,
        }
        for number in range(12)
    ]
    given = {"stages": ["bigmap"], "settings": {"bigmap": {"sites": sites}}}

    def bigmaps() -> set[str]:
        return {path.stem for path in (root / "bigmaps" / "returns").glob("[!.]*.MAP")}

    left = cancelled_at(service, service.submit(JobKind.RUN, **given), bigmaps)
    assert 0 < len(left) < len(sites)
    before = files_in(root / "bigmaps" / "returns")
    again = service.submit(JobKind.RUN, **given)
    service.work(threads=1)
    assert service.store.job(again.id).state is JobState.FINISHED
    assert bigmaps() == {site["name"] for site in sites}
    assert before.items() <= files_in(root / "bigmaps" / "returns").items()


def test_a_worker_that_is_killed_costs_its_items_and_no_more(
    service: Service,
    items: Items,
    by_command: tuple[Path, dict],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = service.submit(stages=["mapolas"])
    store = str(service.folder / ".service" / "store.sqlite")
    # Where users give a URL with a password.
    monkeypatch.setenv("SPCOLA_STORE", store)
    command = worker_command(service.folder, store, OPTIONS)
    assert store not in command[-1]
    supervisor = Supervisor(command, 1, lost=service.store.lost)
    supervisor.start()
    wait_for(items)
    (first,) = supervisor.workers.values()
    os.kill(first, signal.SIGKILL)
    kept = items()
    wait_for(lambda: service.store.job(job.id).state.ended, every=0.05)
    (second,) = supervisor.workers.values()
    supervisor.stop()
    assert second != first
    assert service.store.job(job.id).tries == 2
    check_same(service, job, by_command)
    # At most the one item of each child was made again.
    assert {name: items().get(name) for name in kept} == kept
    logs = list((service.folder / ".service" / "logs").glob("*.jsonl"))
    lines = [json.loads(line) for path in logs for line in path.read_text().splitlines()]
    assert {line["event"] for line in lines} >= {"worker begins", "job begins", "job ends"}
    ends = [line for line in lines if line["event"] == "job ends"]
    assert [(line["job"], line["outcome"]) for line in ends] == [(job.id, "finished")]


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let no file of this process and its children grow beyond a size: a full disk without one."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_waited_for(service: Service) -> None:
    # 3.6 MB of numbers that cannot be compressed.
    points = np.random.default_rng(3).normal([60.0, 0.0, 0.0], 1.0, (150_000, 3))
    lines = ["x,y,z", *(",".join(map(repr, map(float, point))) for point in points)]
    upload = service.upload("big.csv", "\n".join(lines).encode())
    columns = {name: f"{name} [m]" for name in "xyz"}
    job = service.submit(JobKind.IMPORT, uploads=[upload], columns=columns)
    with largest_file(1_000_000):
        service.work(disk_wait_s=0.3)
    assert service.store.job(job.id).state is JobState.WAITING
    assert [note.get("code") for note in service.notes(job)] == ["disk-full"]
    assert not (service.workspace / "scans" / "big.h5").exists()
    time.sleep(0.4)
    service.work()
    done = service.store.job(job.id)
    assert done.state is JobState.FINISHED, done.error
    assert done.result["scans"][0]["returns"] == 150_000
    # No path of the machine.
    assert done.result["scans"][0]["file"] == "big.csv"


def test_a_lost_scheduler_and_another_program_are_waited_for(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fusion.runtime.cluster, "_ANSWER_S", 1)
    job = service.submit(stages=["mapolas"])
    service.work(cluster="tcp://127.0.0.1:1", cluster_wait_s=0.1)
    time.sleep(0.2)
    with (service.workspace / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        service.work()
    assert service.store.job(job.id).state is JobState.WAITING
    codes = [note["code"] for note in service.notes(job) if "code" in note]
    # On a slow machine the scheduler is asked for more than once.
    *lost, last = codes
    assert (set(lost), last) == ({"cluster-lost"}, "busy")


def test_an_upload_that_takes_too_long_is_named(service: Service) -> None:
    upload = service.upload("slow.csv", b"x,y,z\n" + b"1.25,2.5,3.125\n" * 6_000_000)
    columns = {name: f"{name} [m]" for name in "xyz"}
    job = service.submit(JobKind.IMPORT, uploads=[upload], columns=columns)
    service.work(limits=ProcessLimits(4096, 1.0), tries=1)
    error = service.store.job(job.id).error
    assert error is not None
    assert (error.code, error.item) == ("poisonous-item", "slow.csv")
    assert "it took more than 1 s" in error.text


@pytest.mark.parametrize(
    ("parameters", "code", "text"),
    [
        ({"stages": ["none"]}, "invalid-value", "there is no stage 'none'; use ingest, mapolas"),
        ({"stagse": []}, "invalid-value", "run: stagse"),
        ({"only": ["AA0001"]}, "invalid-value", "names items of one stage"),
        ({"settings": {"mapolas": {"gsd_m": -1}}}, "settings", "gsd_m"),
        ({"settings": {"register": {"apply": "/etc/x"}}}, "settings", "out of the workspace"),
        ({"settings": {"spice": {"kernels": ["../../x"]}}}, "settings", "out of the workspace"),
        ({"solution": "../../other"}, "workspace", ""),
    ],
)
def test_what_a_user_may_not_ask_fails_in_one_line(
    service: Service, parameters: dict, code: str, text: str
) -> None:
    job = service.submit(JobKind.RUN, **parameters)
    service.work()
    error = service.store.job(job.id).error
    assert error is not None
    assert error.code == code
    assert text in error.text
    assert str(service.folder) not in error.text


def test_nothing_is_read_outside_the_workspace_of_a_job(service: Service, tmp_path: Path) -> None:
    other = service.upload("other.csv", b"x\n", workspace="other")
    linked = service.upload("link.csv", b"x\n")
    path = service.folder / ".service" / "uploads" / linked / "file" / "link.csv"
    path.unlink()
    path.symlink_to("/etc/passwd")
    (service.folder / "out").symlink_to(tmp_path)
    jobs = [service.submit(JobKind.IMPORT, uploads=[one]) for one in (other, linked)]
    for name in ("out", "..", ".service", "ball/scans"):
        jobs.append(service.store.submit(JobRequest(JobKind.RUN, name, "ann")))
    service.work()
    for job in jobs:
        error = service.store.job(job.id).error
        assert error is not None
        assert "no complete upload" in error.text or "no such workspace" in error.text


def test_a_workspace_is_made_from_uploads(service: Service) -> None:
    solution = sorted((service.workspace / "MAPFILES").glob("AA000[0-2].MAP"))
    uploads = [service.upload(path.name, path.read_bytes(), "new") for path in solution]
    given = {"body": "Ball", "uploads": uploads}
    made = service.store.submit(JobRequest(JobKind.INIT, "new", "ann", given))
    bad = service.upload("AA0009.MAP", b"no maplet", "new")
    given = {"uploads": [bad]}
    refused = service.store.submit(JobRequest(JobKind.INIT, "new", "ann", given, after=(made.id,)))
    service.work()
    assert service.store.job(made.id).result["maplets"] == 3
    error = service.store.job(refused.id).error
    assert error is not None
    assert error.code == "format"
    there = sorted((service.folder / "new" / "MAPFILES").iterdir())
    assert [path.read_bytes() for path in there] == [path.read_bytes() for path in solution]


def test_a_workspace_that_a_lost_worker_began_is_finished_by_the_next(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    maplet = service.workspace / "MAPFILES" / "AA0000.MAP"
    shape = service.upload("SHAPE.OBJ", OCTAHEDRON.encode(), "new")
    given = {
        "body": "Ball",
        "shape": shape,
        "uploads": [service.upload(maplet.name, maplet.read_bytes(), "new")],
    }
    job, root = service.submit_to("new", JobKind.INIT, **given), service.folder / "new"
    file = Places(service.folder, service.store.uploads.get).upload_file("new", shape)
    service.store.claim("lost", 60.0)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", full)
        with pytest.raises(WorkspaceError):
            new_workspace(root, body="Ball", shape=file)
    # A folder without all that was given is no workspace.
    assert not (root / SETTINGS_FILE).exists()
    new_workspace(root, body="Ball", shape=file)
    service.store.lost("lost")
    other = service.upload("SHAPE.OBJ", OCTAHEDRON.replace("0.06", "0.07").encode(), "new")
    second = service.submit_to("new", JobKind.INIT, **given | {"shape": other})
    service.work(threads=1)
    done = service.store.job(job.id)
    assert done.state is JobState.FINISHED, done.error
    assert done.result["maplets"] == 1
    error = service.store.job(second.id).error
    assert error is not None
    assert "another shape" in error.text


def check_made_once(service: Service, codes: list[str]) -> None:
    """Assert that a job whose worker is lost before it records its solution makes no second one."""
    job = service.submit(JobKind.SCALE_APPLY, accept=codes)
    places = Places(service.folder, service.store.uploads.get)
    service.store.claim("lost", 60.0)
    with ProcessExecutor(1) as executor:
        first = perform_job(Assignment(job, places, executor, JobReport(job, lambda *_: None)))
    service.store.lost("lost")
    service.work()
    done = service.store.job(job.id)
    assert done.state is JobState.FINISHED, done.error
    assert done.result["applied"] == places.without_folder_in(first["applied"])
    assert derived_names(service.workspace) == ["s1", "scaled-1"]


def cancelled_in_each_stage(service: Service) -> list[str]:
    """Run all stages, and cancel the job in the middle of each one; return in which it was."""
    stages: list[str] = []
    while True:
        job = service.submit()

        def in_the_middle(job: Job = job) -> bool:
            now = service.store.job(job.id)
            progress = now.progress
            return now.state.ended or (progress.done > 0 and progress.stage not in stages)

        with as_soon_as(in_the_middle, partial(service.store.cancel, job.id), seconds=300.0):
            service.work(threads=1)
        ended = service.store.job(job.id)
        if ended.state is not JobState.CANCELLED:
            assert ended.state is JobState.FINISHED, ended.error
            return stages
        stages.append(ended.progress.stage)


@pytest.mark.slow
def test_a_run_that_was_cancelled_in_each_stage_is_that_of_the_command_to_the_bit(
    service: Service, tmp_path: Path
) -> None:
    mission = tmp_path / "mission"
    make_mission(mission, settings=TINY)
    shutil.rmtree(service.workspace)
    for root in (tmp_path / "ball", service.workspace):
        called("init", root, "--spc", mission / "spc", "--body", "Truth")
        called("import", root, *sorted((mission / "lidar").iterdir()))
    printed = called("run", tmp_path / "ball")
    # The import has done the first stage, and the body has one site of a bigmap.
    stages = {"mapolas", "register", "fuse", "scale", "release"}
    assert stages <= set(cancelled_in_each_stage(service))
    assert {one["state"] for one in printed["stages"]} == {"ran", "up to date"}
    assert files_in(tmp_path / "ball") == files_in(service.workspace)
    findings = json.loads((tmp_path / "ball" / "scale.json").read_text())["findings"]
    codes = [one["code"] for one in findings]
    applied = service.submit(JobKind.SCALE_APPLY, name="s1", accept=codes)
    truth = service.upload("truth.json", (mission / "truth.json").read_bytes())
    assessed = service.submit(JobKind.TRUTH_ASSESS, truth=truth, report="truth.html", patches=5)
    service.work()
    accept = [part for code in codes for part in ("--accept", code)]
    printed = called("scale", tmp_path / "ball", "--apply", "--as", "s1", *accept)
    done = service.store.job(applied.id)
    assert done.state is JobState.FINISHED, done.error
    assert done.result["applied"]["epsilon"] == printed["applied"]["epsilon"]
    for name in ("MAPFILES", "SUMFILES"):
        made = [root / "solutions" / "s1" / name for root in (tmp_path / "ball", service.workspace)]
        assert files_in(made[0]) == files_in(made[1])
    printed = called("truth", "assess", tmp_path / "ball", "--truth", mission, "--patches", 5)
    done = service.store.job(assessed.id)
    assert done.state is JobState.FINISHED, done.error
    assert json.loads(json.dumps(done.result))["models"] == printed["models"]
    assert (service.folder / ".service" / "outputs" / "ball" / "truth.html").is_file()
    check_made_once(service, codes)
