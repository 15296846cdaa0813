"""A Dask scheduler and a worker, each a process of its own, to be killed and started again."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from typing import Self

from distributed import Client


class DaskProcesses:
    """A cluster on a free port of this machine; nothing runs before it is started."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self._port}"
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str) -> None:
        """Start the "scheduler" or the "worker"."""
        words = {
            "scheduler": ["--host", "127.0.0.1", "--port", str(self._port)],
            "worker": [self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"],
        }[name]
        if name == "scheduler":
            words += ["--dashboard-address", ":0"]
        self._running[name] = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + name, *words],
            env={**os.environ, "DASK_DISTRIBUTED__SCHEDULER__DASHBOARD__ENABLED": "false"},
            cwd="/",
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def wait(self, workers: int) -> None:
        """Wait until the scheduler answers and has so many workers."""
        with Client(self.address, timeout=60, set_as_default=False) as client:
            if workers:
                client.wait_for_workers(workers, timeout=60)

    def kill(self, name: str) -> None:
        """End one of them without warning."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for name in list(self._running):
            self.kill(name)
