"""A real process of ``spcola serve``, asked over HTTP."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import httpx
import psutil
from command_line import ROOT


class ServerProcess:
    """Start a server; `url` is where it answers.

    Parameters
    ----------
    folder : Path
        That of the service.
    *options : str
        Of the command.
    errors : file, optional
        For standard error. A pipe that nobody reads would stop the server.
    """

    def __init__(self, folder: Path, *options: str, errors: IO[bytes] | None = None) -> None:
        self.folder, self.options, self.errors = folder, options, errors
        self.port = 0
        self.start()

    def start(self) -> None:
        """Start it, at the same port each time, and wait until it answers."""
        command = [sys.executable, "-m", "fusion.cli", "serve", str(self.folder), "--json"]
        self.process = subprocess.Popen(
            [*command, "--port", str(self.port), *self.options],
            stdout=subprocess.PIPE,
            stderr=self.errors or subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
        )
        # Each job starts as many item processes as there are cores; one shows what two do.
        everywhere = self._keep_to_one_core()
        assert self.process.stdout is not None
        printed = ""
        while not printed.endswith("}\n"):
            line = self.process.stdout.readline()
            assert line, self.process.wait()
            printed += line
        self.url = str(json.loads(printed)["url"])
        self.port = int(self.url.rpartition(":")[2].strip("/"))
        self._let_go(everywhere)

    def _keep_to_one_core(self) -> list[int]:
        """Let the program, while it starts, see one core; return all that it may use."""
        if not hasattr(os, "sched_setaffinity"):  # not on macOS
            return []
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(self.process.pid, {cores[os.getpid() % len(cores)]})
        return cores

    def _let_go(self, cores: list[int]) -> None:
        server = psutil.Process(self.process.pid)
        for one in (server, *server.children()) if cores else ():
            for thread in one.threads():
                with suppress(ProcessLookupError):
                    os.sched_setaffinity(thread.id, cores)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=self.url, timeout=60)

    def workers(self) -> list[int]:
        """Return the process numbers of the workers."""
        children = psutil.Process(self.process.pid).children()
        return [one.pid for one in children if "fusion.service.work.process" in one.cmdline()]

    def kill(self) -> None:
        """End it without warning, if it runs; its workers end with their items."""
        self.process.kill()
        self._wait()

    def _wait(self) -> None:
        self.process.wait(90)
        assert self.process.stdout is not None
        self.process.stdout.close()

    def kill_worker(self) -> int:
        """End the first worker without warning; return its process number."""
        wait_for(self.workers)
        (number, *_) = self.workers()
        os.kill(number, signal.SIGKILL)
        return number

    def stop(self) -> int:
        """End it as a system does; return its exit code."""
        self.process.send_signal(signal.SIGTERM)
        self._wait()
        return self.process.returncode


ASKING_S = 0.1
"""Time between two requests: a server that is asked all the time takes the cores of its workers."""


def wait_for(ready: Callable[[], Any], seconds: float = 60.0, *, every: float = 0.005) -> None:
    """Wait until something is there; it is looked at in intervals of `every` seconds."""
    until = time.monotonic() + seconds
    while not ready():
        assert time.monotonic() < until
        time.sleep(every)
