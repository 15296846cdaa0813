"""Stores of both kinds: an SQLite file, and a data base on a real PostgreSQL server."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import psycopg
import pytest
from postgresql import find_program, postgresql_server

from fusion.service.store import Store


@pytest.fixture(scope="session")
def new_database() -> Iterator[Callable[[], str]]:
    """Make an empty data base on a PostgreSQL server, and return its URL."""
    if find_program("initdb") is None:
        pytest.skip("no PostgreSQL server is installed; on Debian: apt-get install postgresql")
    with postgresql_server() as url:
        _wait_until_ready(url.format("postgres"))
        numbers = count()

        def make() -> str:
            name = f"store{next(numbers)}"
            with psycopg.connect(url.format("postgres"), autocommit=True) as server:
                # A copy of an empty one takes a tenth of the time of a real template.
                server.execute(f"CREATE DATABASE {name} TEMPLATE template0 STRATEGY FILE_COPY")
            return url.format(name)

        yield make


def _wait_until_ready(url: str) -> None:
    for _ in range(500):
        try:
            psycopg.connect(url).close()
            return
        except psycopg.OperationalError:
            continue
    raise AssertionError("the PostgreSQL server does not answer")


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
