"""A real ``spcola serve`` process for tests, which can be killed and started again."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from command_line import ROOT


@dataclass
class ServerProcess:
    """A server of a folder, at the same port each time that it is started."""

    folder: Path
    options: tuple[str, ...] = ()
    port: int = 0
    url: str = ""
    process: subprocess.Popen[str] = field(init=False)

    def start(self) -> ServerProcess:
        """Start it, and wait until it answers."""
        command = [sys.executable, "-m", "fusion.cli", "serve", str(self.folder), "--json"]
        # The log is in a file as well; a pipe that nobody reads would stop the server.
        self.process = subprocess.Popen(
            [*command, "--port", str(self.port), *self.options],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT,
        )  # fmt: skip
        assert self.process.stdout is not None
        printed = ""
        while not printed.endswith("}\n"):
            line = self.process.stdout.readline()
            assert line, self.process.communicate()
            printed += line
        self.url = json.loads(printed)["url"]
        self.port = int(self.url.rpartition(":")[2].strip("/"))
        return self

    def kill(self) -> None:
        """Kill it, as the power cut does."""
        self.process.kill()
        self.process.communicate()
