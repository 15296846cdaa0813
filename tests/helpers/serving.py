"""The real server process: ``spcola serve``."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from command_line import ROOT


@contextmanager
def serving(folder: Path, *options: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Serve a folder on a free port; yield the process and its URL."""
    command = [sys.executable, "-m", "fusion.cli", "serve", folder, "--port", 0, "--json", *options]
    # The log is in a file as well; a pipe that nobody reads would stop the server.
    process = subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=ROOT,
    )
    try:
        assert process.stdout is not None
        printed = ""
        while not printed.endswith("}\n"):
            line = process.stdout.readline()
            assert line, process.communicate()
            printed += line
        yield process, json.loads(printed)["url"]
    finally:
        process.kill()
        process.communicate()
