"""Stores of both kinds: an SQLite file, and a data base on a real PostgreSQL server."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from postgresql import find_program, postgresql_server

from fusion.service.store import Store


@pytest.fixture(scope="session")
def new_database() -> Iterator[Callable[[], str]]:
    """Make an empty data base on a PostgreSQL server, and return its URL."""
    if find_program("initdb") is None:
        pytest.skip("no PostgreSQL server is installed; on Debian: apt-get install postgresql")
    with postgresql_server() as server:
        numbers = count()
        yield lambda: server.new_database(f"store{next(numbers)}")


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder in memory where there is one: disks take most of the time of these tests."""
    memory = Path("/dev/shm")
    if not os.access(memory, os.W_OK):
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(prefix="spcola-", dir=memory) as name:
        yield Path(name)


@pytest.fixture(params=["sqlite", "postgresql"])
def new_url(request: pytest.FixtureRequest, folder: Path) -> Callable[[], str]:
    """Return the URL of a new store at each call."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_database")
    numbers = count()
    return lambda: str(folder / f"store{next(numbers)}.sqlite")


@pytest.fixture
def store(new_url: Callable[[], str]) -> Iterator[Store]:
    with Store(new_url()) as opened:
        yield opened
