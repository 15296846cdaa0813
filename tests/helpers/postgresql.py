"""A PostgreSQL server of the test's own: in a new folder, on a socket, without a network port."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_ACCOUNT = "postgres"  # of Debian's package; the server refuses to run as root


def find_program(name: str) -> str | None:
    """Return the path of a program of PostgreSQL; Debian keeps them outside PATH."""
    places = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return shutil.which(name, path=os.pathsep.join([os.environ["PATH"], *map(str, places)]))


@contextmanager
def postgresql_server() -> Iterator[str]:
    """Start a server; yield a URL to which the name of a data base is added."""
    initdb, postgres = str(find_program("initdb")), str(find_program("postgres"))
    folder = Path(tempfile.mkdtemp(prefix="spcola-postgresql-"))
    as_account: dict[str, Any] = {"cwd": folder}
    if os.geteuid() == 0:
        shutil.chown(folder, _ACCOUNT, _ACCOUNT)
        as_account |= {"user": _ACCOUNT, "group": _ACCOUNT, "extra_groups": []}
    data = folder / "data"
    make = [initdb, "-D", data, "-U", "spcola", "-A", "trust", "--no-sync", "--no-instructions"]
    subprocess.run(make, check=True, stdout=subprocess.DEVNULL, **as_account)
    options = ["listen_addresses=", f"unix_socket_directories={folder}", "fsync=off"]
    command = [postgres, "-D", data, *(part for one in options for part in ("-c", one))]
    log = (folder / "log").open("w")
    server = subprocess.Popen(command, stdout=log, stderr=log, **as_account)
    try:
        while not (folder / ".s.PGSQL.5432").exists():
            assert server.poll() is None, (folder / "log").read_text()
            time.sleep(0.02)
        yield f"postgresql://spcola@/{{}}?host={folder}"
    finally:
        server.terminate()
        server.send_signal(3)  # SIGQUIT: at once, whoever is connected
        server.wait(30)
        log.close()
        shutil.rmtree(folder)
