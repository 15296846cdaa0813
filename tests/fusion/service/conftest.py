"""A workspace for the tests of the service, and what the commands make of it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import called
from served import MAPLETS

from fusion.workspace import new_workspace
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maplets in a row on hills, under two scans; nobody changes it."""
    root = tmp_path_factory.mktemp("service") / "ball"
    made = new_workspace(root, body="Ball")
    rng = np.random.default_rng(1)
    for number in range(MAPLETS):
        normal = np.array([1.0, 0.04 * number - 0.4, 0.0])
        normal /= np.linalg.norm(normal)
        grid = MapletGrid.facing(60.0 * normal, normal, 0.3, 24)
        name = f"AA{number:04d}"
        write_maplet(root / "MAPFILES" / f"{name}.MAP", Maplet(name, grid, np.zeros(grid.shape)))
    for number in range(2):
        away = np.column_stack([np.ones(20_000), rng.uniform(-0.45, 0.45, (20_000, 2))])
        away[:, 2] *= 0.3
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        height = 60.0 + 0.4 * np.sin(40 * away[:, 1]) * np.cos(35 * away[:, 2])
        points = height[:, None] * away + 0.03 * rng.normal(size=3)
        scan = Scan.of_points(f"scan{number}", points, body="Ball")
        write_scan(made.scan_path(scan.name), [scan])
    return root


@pytest.fixture(scope="session")
def by_command(ball: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """The workspace after the command ``mapolas``, and what that printed; nobody changes it."""
    root = shutil.copytree(ball, tmp_path_factory.mktemp("command") / "ball")
    return root, called("mapolas", root)
