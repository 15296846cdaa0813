"""A served folder with a small workspace that has some results, and sessions on it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from served import make_ball
from server_process import ServerProcess

from fusion.client import Session, connect
from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from spcola.grids import MapletGrid


@pytest.fixture(scope="module")
def missions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("missions")
    make_ball(root / "ball")
    grid = MapletGrid.facing(np.array([0.0, 60.0, 0]), np.array([0, 1.0, 0]), 0.3, 150)
    heights = np.add.outer(np.arange(301.0), np.arange(301.0) ** 2) / 1e4
    heights[5:9, 20] = np.nan
    known = np.full(grid.shape, 0.1)
    fused = FusedMaplet(
        "AA0001", grid, heights, known, known, count=np.full(grid.shape, 3),
        source=np.where(np.isfinite(heights), Source.BOTH, Source.NONE),
    )  # fmt: skip
    write_fused(root / "ball" / "fused", [fused])
    match = {
        "name": "AA0001", "center_m": [60.0, 0, 0], "residual_m": [0.1, 0.2, 0.3],
        "sigma_m": [0.1, 0.1, 0.1], "used": True, "reason": "", "cause": None,
    }  # fmt: skip
    registration = {"model": "rigid", "verdict": "accepted", "n_used": 1, "per_mapola": [match]}
    (root / "ball" / "registration.json").write_text(json.dumps(registration))
    pair = {"image": "A", "epsilon": 1e-4, "local_time_h": 9.5, "longitude_deg": 3.0, "used": True}
    scale = {"epsilon": 1e-4, "epsilon_sigma": 1e-5, "per_pair": [pair], "per_day": [{"day": "x"}]}
    (root / "ball" / "scale.json").write_text(json.dumps(scale))
    outputs = root / ".service" / "outputs" / "ball" / "kernels"
    outputs.mkdir(parents=True)
    (outputs / "a.bc").write_bytes(b"kernel")
    return root


@pytest.fixture(scope="module")
def server(missions: Path) -> Iterator[ServerProcess]:
    started = ServerProcess(missions)
    yield started
    started.kill()


@pytest.fixture(scope="module")
def remote(server: ServerProcess) -> Iterator[Session]:
    with connect(server.url) as session:
        yield session


@pytest.fixture(scope="module")
def local(missions: Path) -> Iterator[Session]:
    with connect(missions) as session:
        yield session
