"""A service with two workspaces, asked in this process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from asgi_client import AsgiClient

from fusion.service.api import Limits, Service, create_app
from fusion.service.store import Store
from fusion.workspace import new_workspace
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    """Workspaces `ball`, with one maplet, and `other`."""
    root = tmp_path / "missions"
    for name in ("ball", "other"):
        new_workspace(root / name, body=name)
    grid = MapletGrid.facing(np.array([60.0, 0, 0]), np.array([1.0, 0, 0]), 0.5, 12)
    height = np.add.outer(np.arange(25.0), np.zeros(25)) / 10.0
    write_maplet(root / "ball/MAPFILES/AA0001.MAP", Maplet("AA0001", grid, height))
    with Store(root / ".service" / "store.sqlite") as store:
        yield Service(root, store, Limits(heartbeat_s=0.2, upload_bytes=10_000, uploads=3))


@pytest.fixture
def client(service: Service) -> Iterator[AsgiClient]:
    """Asks as the user of this machine."""
    with AsgiClient(create_app(service)) as asking:
        yield asking
