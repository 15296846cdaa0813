"""Real servers, which end with their test."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from server_process import ServerProcess


@pytest.fixture
def missions(ball: Path, tmp_path: Path) -> Path:
    """A folder of the service with one small workspace, `ball`."""
    shutil.copytree(ball, tmp_path / "missions" / "ball")
    return tmp_path / "missions"


@pytest.fixture
def serve(missions: Path) -> Iterator[Callable[..., ServerProcess]]:
    """Start a server on the missions."""
    started: list[ServerProcess] = []

    def start(*options: str, **more: object) -> ServerProcess:
        started.append(ServerProcess(missions, *options, **more))
        return started[-1]

    yield start
    for server in started:
        server.kill()
