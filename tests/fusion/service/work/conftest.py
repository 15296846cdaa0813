"""A service with one small workspace."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from served import Service

from fusion.service.store import Store


@pytest.fixture
def service(ball: Path, tmp_path: Path) -> Iterator[Service]:
    folder = tmp_path / "service"
    shutil.copytree(ball, folder / "ball")
    with Store(folder / ".service" / "store.sqlite") as store:
        yield Service(folder, store)


@pytest.fixture
def items(service: Service) -> Callable[[], dict[str, int]]:
    """The finished items of the stage `mapolas`: the number of each file on the disk."""
    return lambda: {
        path.name: path.stat().st_ino
        for path in (service.workspace / ".items" / "mapolas").glob("[!.]*.npz")
    }
