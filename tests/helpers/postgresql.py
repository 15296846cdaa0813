"""A PostgreSQL server of the test's own: in a new folder, on a socket, without a network port."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg

_ACCOUNT = "postgres"  # of Debian's package; the server refuses to run as root


def find_program(name: str) -> str | None:
    """Return the path of a program of PostgreSQL; Debian keeps them outside PATH."""
    places = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return shutil.which(name, path=os.pathsep.join([os.environ["PATH"], *map(str, places)]))


class PostgresqlServer:
    """A server that can be stopped and started again; `url` lacks the name of a data base."""

    def __init__(self) -> None:
        initdb = str(find_program("initdb"))
        self._folder = Path(tempfile.mkdtemp(prefix="spcola-postgresql-"))
        self._as_account: dict[str, Any] = {"cwd": self._folder}
        if os.geteuid() == 0:
            shutil.chown(self._folder, _ACCOUNT, _ACCOUNT)
            self._as_account |= {"user": _ACCOUNT, "group": _ACCOUNT, "extra_groups": []}
        make = [initdb, "-D", self._data, "-U", "spcola", "-A", "trust"]
        quick = ["--no-sync", "--no-instructions"]
        subprocess.run([*make, *quick], check=True, stdout=subprocess.DEVNULL, **self._as_account)
        self.url = f"postgresql://spcola@/{{}}?host={self._folder}"
        self.start()

    @property
    def _data(self) -> Path:
        return self._folder / "data"

    def start(self) -> None:
        """Start the server, and wait until it answers."""
        options = [
            "listen_addresses=",
            f"unix_socket_directories={self._folder}",
            "fsync=off",
        ]
        command = [str(find_program("postgres")), "-D", self._data]
        command += [part for one in options for part in ("-c", one)]
        with (self._folder / "log").open("a") as log:
            self._server = subprocess.Popen(command, stdout=log, stderr=log, **self._as_account)
        while True:
            assert self._server.poll() is None, (self._folder / "log").read_text()
            try:
                psycopg.connect(self.url.format("postgres")).close()
                return
            except psycopg.OperationalError:
                time.sleep(0.02)

    def stop(self) -> None:
        """Stop the server at once, whoever is connected, as if its host had failed."""
        self._server.send_signal(signal.SIGQUIT)
        self._server.wait(30)

    def new_database(self, name: str) -> str:
        """Make an empty data base; return its URL."""
        with psycopg.connect(self.url.format("postgres"), autocommit=True) as server:
            # A copy of an empty one takes a tenth of the time of a real template.
            server.execute(f"CREATE DATABASE {name} TEMPLATE template0 STRATEGY FILE_COPY")
        return self.url.format(name)

    def remove(self) -> None:
        """Stop the server and remove its folder."""
        self.stop()
        shutil.rmtree(self._folder)


@contextmanager
def postgresql_server() -> Iterator[PostgresqlServer]:
    """Open a server of one's own."""
    server = PostgresqlServer()
    try:
        yield server
    finally:
        server.remove()
