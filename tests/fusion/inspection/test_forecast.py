"""Forecast of time, memory and disk for mapolas."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command_line import app
from typer.testing import CliRunner

from fusion.inspection import import_forecast
from fusion.inspection.forecasts import stage_forecasts
from fusion.inspection.forecasts.mapolas import BYTES_PER_RETURN
from fusion.inspection.import_forecast import ImportClock
from fusion.pipeline import Pipeline
from fusion.runtime import ThreadExecutor
from fusion.runtime.machine import PROGRAM_BYTES
from fusion.stages.ingest import stage as ingest
from fusion.stages.mapolas import stage as mapolas
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from lidar.formats.native import ScanFile
from lidar.scans import Scan


@pytest.fixture
def workspace(under_a_scan) -> Workspace:
    """Two maplets under a scan, and one on the far side of the ball."""
    return under_a_scan((0.0, 0.4, 3.0))


def test_the_forecast_counts_what_is_there(workspace: Workspace) -> None:
    settings = Settings().with_table("mapolas", adjust=False)
    found = stage_forecasts(workspace, settings, only="mapolas", workers=2)["mapolas"].details
    assert (found["grids"], found["with_returns"]) == (3, 2)
    (path,) = workspace.scan_paths()
    assert found["scan_bytes"] == path.stat().st_size
    assert found["tiles"] == sum(len(block.cubes.cube) for block in ScanFile(path).blocks)
    stages = [ingest.STAGE, mapolas.STAGE]
    run = Pipeline(workspace, settings, stages, ThreadExecutor(2)).run_stage("mapolas")
    used = run.summary["returns_used"]
    # Cubes and spheres reach beyond the squares of the grids.
    assert used < found["returns"] < 8 * used
    assert 0.0 < found["minutes"] < 5.0
    assert found["memory_mb"] > PROGRAM_BYTES / 1e6
    assert found["memory_mb"] < (PROGRAM_BYTES + 64 * BYTES_PER_RETURN * 30_000) / 1e6


class Watch:
    """A clock that goes on only while something is at work, by so many seconds a return."""

    def __init__(self, reading: float, packing: float, digest: float) -> None:
        self.time = 0.0
        self.reading, self.packing, self.digest = reading, packing, digest

    def __call__(self) -> float:
        return self.time

    def chunks(self, sizes: list[int]) -> Iterator[Scan]:
        for size in sizes:
            self.time += self.reading * size
            yield Scan.of_points("one", np.full((size, 3), 100.0))

    def write_scan(self, path: Path, scans: list[Scan]) -> None:
        self.time += self.packing * len(scans[0])
        path.write_bytes(bytes(10 * len(scans[0])))

    def file_digest(self, path: Path) -> None:
        self.time += self.digest * path.stat().st_size


@pytest.fixture
def source(tmp_path: Path) -> Path:
    (tmp_path / "source").write_bytes(bytes(5000))
    return tmp_path / "source"


def import_s(watch: Watch, sizes: list[int], source: Path, patch: pytest.MonkeyPatch) -> float:
    patch.setattr(import_forecast, "write_scan", watch.write_scan)
    patch.setattr(import_forecast, "file_digest", watch.file_digest)
    clock = ImportClock(watch)
    for _ in clock.timed(watch.chunks(sizes)):
        watch.time += 1000.0  # what the caller does with a chunk is no part of an import
    seconds: float = clock.forecast(source)["import_s"]
    return seconds


@pytest.mark.parametrize("sizes", [[1000], [600, 0, 400], [0, 1000], [300_000, 200_000], [0], []])
def test_an_import_takes_reading_packing_and_digests(
    source: Path, monkeypatch: pytest.MonkeyPatch, sizes: list[int]
) -> None:
    """Of all returns and both files, though only a part of the first chunk is packed."""
    returns, reading, packing, digest = sum(sizes), 3e-5, 2e-5, 1e-6
    wanted = returns * (reading + packing + 10 * digest) + digest * 5000 * bool(returns)
    found = import_s(Watch(reading, packing, digest), sizes, source, monkeypatch)
    assert found == pytest.approx(wanted)


@pytest.mark.parametrize("slow", [(3.0, 1.0, 1.0), (1.0, 3.0, 1.0), (1.0, 1.0, 3.0)])
def test_a_slow_reader_packing_or_disk_gives_a_longer_forecast(
    source: Path, monkeypatch: pytest.MonkeyPatch, slow: tuple[float, float, float]
) -> None:
    usual = import_s(Watch(1.0, 1.0, 1.0), [5000], source, monkeypatch)
    assert import_s(Watch(*slow), [5000], source, monkeypatch) > 1.1 * usual


def test_memory_of_an_import_is_that_of_a_chunk_at_most(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clocks = [ImportClock() for _ in range(3)]
    for clock, returns in zip(clocks, (1000, 1_000_000, 50_000_000), strict=True):
        clock.returns = returns
    taken = [clock.forecast(source)["import_memory_mb"] for clock in clocks]
    assert taken[0] < taken[1] == taken[2]


def test_info_forecasts_the_import_of_a_file(tmp_path: Path) -> None:
    points = 100.0 + np.random.default_rng(1).normal(size=(20_000, 3))
    path = tmp_path / "track.csv"
    np.savetxt(path, points, delimiter=",", header="x_m,y_m,z_m", comments="", fmt="%.4f")
    facts = json.loads(CliRunner().invoke(app, ["info", str(path), "--json"]).stdout)
    assert facts["returns"] == 20_000
    assert 0.0 < facts["import_s"] < 60.0
    assert PROGRAM_BYTES / 1e6 < facts["import_memory_mb"] < 1.1 * PROGRAM_BYTES / 1e6
    assert sorted(tmp_path.iterdir()) == [path]


def test_without_room_for_a_sample_there_is_no_time(
    source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    watch = Watch(1.0, 1.0, 1.0)
    clock = ImportClock(watch)
    list(clock.timed(watch.chunks([10])))
    monkeypatch.setattr(import_forecast, "write_scan", full)
    assert clock.forecast(source)["import_s"] is None
