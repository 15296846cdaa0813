"""Views are made ready by a process of its own, after jobs."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from ball import RADIUS, ball_workspace
from server_process import wait_for

from fusion.service.api import Service
from fusion.service.jobs import Event
from fusion.service.store import Store
from fusion.service.upkeep import Preparer, preparing
from spcola.formats.shapes import write_obj_mesh
from spcola.shape.icq import IcqShape, icq_directions


@pytest.mark.slow
def test_a_job_that_has_ended_has_its_views_made_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preparing, "_QUIET_S", 0.0)
    monkeypatch.setattr(preparing, "_MANY_MAPLETS", 1)
    with Store(tmp_path / "store.sqlite") as store:
        service = Service(tmp_path, store)
        with Preparer(service) as preparer:
            made = ball_workspace(tmp_path / "ball")
            mesh = IcqShape(RADIUS * icq_directions(8)).mesh()
            write_obj_mesh(made.root / "SHAPEFILES" / "ball.obj", mesh)
            for state in ("running", "finished"):
                preparer.heed(Event(1, "J", "ball", math.nan, "state", {"state": state}))
            # Outlines of four kinds, the mesh, and its five layers.
            cache = tmp_path / ".service" / "cache"
            wait_for(lambda: len(list(cache.glob("*.npz"))) >= 7)
        assert not service.feed.listeners[1:]
