"""Runs the commands of the tutorial, and puts what they print below them.

Every ``console`` block of the page is run in its order, in a folder that `conf.py` names. What the
commands leave there is what figures and examples are made of. A command that fails ends the build.
Nothing is run again as long as the page and the program stay as they are.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

PAGE = "tutorial/command_line"
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MOST_LINES = 24
PACKAGES = ("spcola", "lidar", "fusion")
DONE = "printed.json"
LIMIT_S = 600
logger = logging.getLogger(__name__)


def commands(text: str) -> Iterator[str]:
    """Yield the command lines of all console blocks of a page."""
    for block in BLOCK.findall(text):
        for line in block.splitlines():
            if line.startswith("$ "):
                yield line.removeprefix("$ ")


def fingerprint(text: str, checkout: Path) -> str:
    """Digest of the commands and of the program that they run."""
    digest = hashlib.sha256("\n".join(commands(text)).encode())
    for package in PACKAGES:
        for path in sorted((checkout / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def run(command: str, folder: Path) -> str:
    """Run one command line in `folder` and return what it prints on standard output.

    Raises
    ------
    ExtensionError
        If it fails.
    """
    program = f'spcola() {{ "{sys.executable}" -m fusion.cli "$@"; }}\n'
    ended = subprocess.run(
        ["bash", "-euc", program + command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    if ended.returncode:
        raise ExtensionError(f"{PAGE}: {command!r} fails: {ended.stderr.strip()}")
    return ended.stdout.rstrip()


def run_all(app: Sphinx) -> None:
    """Run the tutorial, unless it was run as it is."""
    text = (Path(app.srcdir) / f"{PAGE}.md").read_text(encoding="utf-8")
    folder = Path(app.config.TUTORIAL)
    done = folder / DONE
    mark = fingerprint(text, Path(app.srcdir).parent)
    if done.is_file() and json.loads(done.read_text(encoding="utf-8"))["of"] == mark:
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    printed: dict[str, str] = {}
    for command in commands(text):
        logger.info("tutorial: %s", command)
        printed[command] = run(command, folder)
    done.write_text(json.dumps({"of": mark, "printed": printed}), encoding="utf-8")


def shortened(text: str) -> str:
    """Return `text` with its middle left out where it is long."""
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 3], "…", *lines[-2:]]
    return "\n".join(lines)


def insert(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put below each command of the tutorial what it printed."""
    if docname != PAGE:
        return
    done = json.loads((Path(app.config.TUTORIAL) / DONE).read_text(encoding="utf-8"))

    def filled(match: re.Match[str]) -> str:
        lines = []
        for line in match.group(1).splitlines():
            lines.append(line)
            printed = done["printed"].get(line.removeprefix("$ "), "")
            lines += [shortened(printed)] if printed else []
        return "```console\n" + "\n".join(lines) + "\n```"

    source[0] = BLOCK.sub(filled, source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Run the commands before anything is read, and show what they print."""
    app.add_config_value("TUTORIAL", None, "")
    app.connect("builder-inited", run_all, priority=100)
    app.connect("source-read", insert)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
