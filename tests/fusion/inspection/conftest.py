"""A workspace whose stages have something to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from fusion.workspace import Workspace, new_workspace
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


@pytest.fixture
def under_a_scan(tmp_path: Path) -> Callable[[Sequence[float]], Workspace]:
    """Makes a workspace of maplets at some longitudes, radians, of a ball, and a scan over 0.7."""

    def make(longitudes: Sequence[float]) -> Workspace:
        made = new_workspace(tmp_path / "ws", body="Ball")
        for number, east in enumerate(longitudes):
            normal = np.array([np.cos(east), np.sin(east), 0.0])
            grid = MapletGrid.facing(60.0 * normal, normal, 0.5, 10)
            flat = Maplet(f"AA{number:04d}", grid, np.zeros(grid.shape))
            write_maplet(made.root / "MAPFILES" / f"{flat.name}.MAP", flat)
        rng = np.random.default_rng(1)
        longitude, z = rng.uniform(-0.3, 0.7, 30_000), rng.uniform(-0.25, 0.25, 30_000)
        across = np.sqrt(1.0 - z**2)
        away = np.stack([across * np.cos(longitude), across * np.sin(longitude), z], axis=1)
        scan = Scan.of_points("one", 60.0 * away, body="Ball")
        write_scan(made.root / "scans" / "one.h5", [scan])
        return made

    return make
