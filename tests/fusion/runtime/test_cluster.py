"""The same work on a Dask cluster: the same results to the bit, also when a worker dies."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from command_line import app
from dask_processes import DaskProcesses
from distributed import Client, LocalCluster
from PIL import Image
from typer.testing import CliRunner

import fusion.runtime.cluster
from fusion.runtime import ClusterExecutor
from fusion.runtime.cluster import ClusterError
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from fusion.workspace.settings import write_settings
from lidar.formats.native import ScanFile, write_scan
from lidar.scans import Scan
from spcola.errors import SettingsError, WorkspaceError
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The scheduler of a cluster of two processes."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield str(cluster.scheduler_address)


@pytest.fixture
def executor(address: str) -> Iterator[ClusterExecutor]:
    made = ClusterExecutor(address)
    yield made
    made.close()


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """Six maplets side by side on hills, under four scans that err by centimetres."""
    made = new_workspace(tmp_path / "ws", body="Ball")
    rng = np.random.default_rng(1)
    for number in range(6):
        normal = np.array([1.0, 0.12 * number - 0.3, 0.0])
        normal /= np.linalg.norm(normal)
        grid = MapletGrid.facing(60.0 * normal, normal, 0.5, 10)
        name = f"AA{number:04d}"
        write_maplet(
            made.root / "MAPFILES" / f"{name}.MAP", Maplet(name, grid, np.zeros(grid.shape))
        )
    for number in range(4):
        away = np.column_stack([np.ones(12_000), rng.uniform(-0.45, 0.45, (12_000, 2))])
        away[:, 2] *= 0.3
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        height = 60.0 + 0.4 * np.sin(40 * away[:, 1]) * np.cos(35 * away[:, 2])
        points = height[:, None] * away + 0.03 * rng.normal(size=3)
        write_scan(
            made.root / "scans" / f"scan{number}.h5",
            [Scan.of_points(f"scan{number}", points, body="Ball")],
        )
    return made


def pid(_: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def test_results_come_in_order_from_other_processes(executor: ClusterExecutor) -> None:
    shift = 7
    assert list(executor.stream(lambda item: item * item + shift, range(30))) == [
        item * item + shift for item in range(30)
    ]
    workers = set(executor.stream(pid, range(8)))
    assert len(workers) == 2
    assert os.getpid() not in workers
    assert executor.workers == 2


def test_items_are_read_only_as_workers_become_free(executor: ClusterExecutor) -> None:
    read = 0

    def items() -> Iterator[int]:
        nonlocal read
        for item in range(1000):
            read += 1
            yield item

    stream = executor.stream(abs, items())
    assert next(stream) == 0
    assert read <= 4
    stream.close()


def test_an_error_of_a_worker_is_that_of_the_caller(executor: ClusterExecutor) -> None:
    def fail(item: int) -> int:
        if item == 3:
            raise WorkspaceError("is not there", "/data/scan", "restore it")
        return item

    with pytest.raises(WorkspaceError, match="/data/scan: is not there; restore it") as raised:
        list(executor.stream(fail, range(100)))
    assert raised.value.do == "restore it"


def test_a_worker_that_is_killed_changes_nothing_but_the_time(executor: ClusterExecutor) -> None:
    def slow(item: int) -> tuple[int, int]:
        time.sleep(0.1)
        return item, os.getpid()

    stream = executor.stream(slow, range(30))
    first = next(stream)
    os.kill(first[1], signal.SIGKILL)
    rest = list(stream)
    assert [item for item, _ in [first, *rest]] == list(range(30))
    # The nanny starts another one in its place.
    assert rest[-1][1] != first[1]


def test_mapolas_made_by_a_cluster_are_the_same_bytes(
    address: str, workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = shutil.copytree(workspace.root, workspace.root.parent / "other")
    # As README gives it: a path that means nothing in the folder of the workers.
    monkeypatch.chdir(other.parent)
    for root, choice in (("ws", ["--workers", "2"]), ("other", ["--cluster", address])):
        result = CliRunner().invoke(app, ["mapolas", root, *choice])
        assert result.exit_code == 0, result.output
    there = Workspace.open(other)
    assert there.mapola_names() == workspace.mapola_names()
    assert len(there.mapola_names()) == 6
    for name in there.mapola_names():
        one, two = workspace.mapola(name), there.mapola(name)
        for layer in ("height", "sigma", "count", "spread"):
            np.testing.assert_array_equal(getattr(one, layer), getattr(two, layer))
        assert one.scan_share == two.scan_share
    first, second = workspace.adjustment(), there.adjustment()
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.displacement, second.displacement)
    np.testing.assert_array_equal(first.covariance, second.covariance)
    assert np.abs(first.displacement[:, :3]).max() > 0.005


def test_images_brought_in_by_a_cluster_are_the_same_bytes(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    for number in range(4):
        pixels = rng.integers(0, 4000, (64, 64), dtype=np.uint16)
        Image.fromarray(pixels).save(tmp_path / f"P{number}.png")
    names = [f"P{number}.png" for number in range(4)]
    Image.fromarray(np.full((64, 64), 9, np.uint16)).save(tmp_path / "dark.png")
    found, kept = [], []
    for root, choice in (("here", ["--workers", "2"]), ("there", ["--cluster", address])):
        new_workspace(tmp_path / root, body="Ball")
        command = ["images", root, *names, "--dark", "dark.png", "--report", "--json", *choice]
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 0, result.output
        content = json.loads(result.stdout)
        found.append({key: content[key] for key in ("new", "images", "counts")})
        files = sorted((tmp_path / root).glob("IMAGEFILES/*"))
        kept.append({path.name: path.read_bytes() for path in files})
    assert len(kept[0]) == 4
    assert kept[0] == kept[1]
    assert found[0] == found[1]


def test_scans_read_by_a_cluster_are_the_same_bytes(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """… also those that other settings have it read again."""
    monkeypatch.chdir(tmp_path)
    points = np.random.default_rng(3).normal([60.0, 0.0, 0.0], 1.0, (500, 3))
    table = tmp_path / "shots.csv"
    np.savetxt(table, points, delimiter=",", header="X [m],Y [m],Z [m]", comments="")
    made = []
    for name, choice in (("here", ["--workers", "2"]), ("there", ["--cluster", address])):
        root = new_workspace(tmp_path / name, body="Ball").root
        columns = ["--columns", "x=X [m],y=Y [m],z=Z [m]"]
        result = CliRunner().invoke(app, ["import", name, "shots.csv", *columns, *choice])
        assert result.exit_code == 0, result.output
        settings = Workspace.open(root).settings().with_table("import", sigma_range_m=0.07)
        write_settings(root / SETTINGS_FILE, settings)
        result = CliRunner().invoke(app, ["run", name, *choice])
        assert "ingest: ran" in result.output
        scan = ScanFile(root / "scans" / "shots.h5")
        assert scan.blocks[0].numbers["sigma"] == pytest.approx(0.07)
        made.append((root / "scans" / "shots.h5").read_bytes())
    assert made[0] == made[1]


def test_a_missing_cluster_is_reported(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fusion.runtime.cluster, "_ANSWER_S", 1)
    with pytest.raises(SettingsError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        ClusterExecutor("tcp://127.0.0.1:9")
    words = ["mapolas", str(workspace.root), "--cluster", "tcp://127.0.0.1:9"]
    result = CliRunner().invoke(app, [*words, "--workers", "2"])
    assert result.exit_code == 2
    assert "a cluster has its own workers" in result.output


@pytest.fixture
def lonely() -> Iterator[DaskProcesses]:
    """A scheduler and one worker."""
    with DaskProcesses() as cluster:
        cluster.start("scheduler")
        cluster.start("worker")
        cluster.wait(1)
        yield cluster


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dies", "message"),
    [("scheduler", "does not answer any more"), ("worker", "has lost all its workers")],
)
def test_a_lost_cluster_is_reported_in_one_line(
    lonely: DaskProcesses,
    monkeypatch: pytest.MonkeyPatch,
    dies: str,
    message: str,
) -> None:
    def nap(item: int) -> int:  # here, so that workers need not import this file
        time.sleep(0.3)
        return item

    executor = ClusterExecutor(lonely.address)
    monkeypatch.setattr(fusion.runtime.cluster, "_ANSWER_S", 2)
    monkeypatch.setattr(fusion.runtime.cluster, "_LOOK_S", 0.5)
    stream = executor.stream(nap, range(50))
    assert next(stream) == 0
    lonely.kill(dies)
    begun = time.monotonic()
    with pytest.raises(
        ClusterError, match=f"{lonely.address}.*{message}.*what is finished is kept"
    ):
        list(stream)
    executor.close()
    assert time.monotonic() - begun < 60


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_a_port_of_something_else_is_refused_in_time(
    answer: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Silent, or a web server (such as the scheduler's own dashboard)."""
    monkeypatch.setattr(fusion.runtime.cluster, "_ANSWER_S", 1)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    connections.append(connection)
                    connection.sendall(answer)

        connections: list[socket.socket] = []
        Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(SettingsError, match=f"no Dask scheduler answers at {address}"):
            ClusterExecutor(address)
        assert time.monotonic() - begun < 20
        for connection in connections:
            connection.close()


def test_a_worker_is_not_taken_for_the_scheduler(address: str) -> None:
    with Client(address, set_as_default=False) as client:
        worker = next(iter(client.scheduler_info()["workers"]))
    with pytest.raises(SettingsError, match=r"is the address of a worker, not of the Dask sched"):
        ClusterExecutor(worker)


def test_workers_of_other_versions_are_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = {**fusion.runtime.cluster.versions(), "numpy": "1.0"}
    real = fusion.runtime.cluster.versions

    class Here:
        """Says here that numpy is old; on a worker the module's own function runs."""

        def __call__(self) -> dict[str, str]:
            return mine

        def __reduce__(self) -> tuple[object, ...]:
            return getattr, (real, "__call__")

    monkeypatch.setattr(fusion.runtime.cluster, "versions", Here())
    with pytest.raises(SettingsError, match=r"has numpy 2.*, not numpy 1\.0"):
        ClusterExecutor(address)
