"""What mapolas will take, said before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.executor import ThreadExecutor
from fusion.forecast import BYTES_PER_RETURN, mapolas_forecast
from fusion.initialise import new_workspace
from fusion.memory import PROGRAM_BYTES
from fusion.pipeline import Pipeline
from fusion.settings import Settings
from fusion.stages import ingest, mapolas
from fusion.workspace import Workspace
from lidar.formats.native import ScanFile, write_scan
from lidar.scan import Scan
from spcola.formats.map import write_maplet
from spcola.maplet import Maplet, MapletGrid


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    """Two maplets under a scan, and one on the far side of the ball."""
    made = new_workspace(tmp_path / "ws", body="Ball")
    for number, longitude in enumerate((0.0, 0.4, 3.0)):
        normal = np.array([np.cos(longitude), np.sin(longitude), 0.0])
        grid = MapletGrid.facing(60.0 * normal, normal, 0.5, 10)
        flat = Maplet(f"AA{number:04d}", grid, np.zeros(grid.shape))
        write_maplet(made.root / "MAPFILES" / f"{flat.name}.MAP", flat)
    rng = np.random.default_rng(1)
    longitude, z = rng.uniform(-0.3, 0.7, 30_000), rng.uniform(-0.25, 0.25, 30_000)
    across = np.sqrt(1.0 - z**2)
    away = np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)
    write_scan(made.root / "scans" / "one.h5", [Scan.of_points("one", 60.0 * away, body="Ball")])
    return made


def test_the_forecast_counts_what_is_there(workspace: Workspace) -> None:
    settings = Settings().with_table("mapolas", adjust=False)
    found = mapolas_forecast(workspace, settings)
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


def test_where_none_can_be_made_there_is_none(tmp_path: Path) -> None:
    assert mapolas_forecast(new_workspace(tmp_path / "ws", body="Ball"), Settings()) == {}
