"""Runs the commands of the tutorials, and puts what they print below them.

Every ``console`` block of the pages is run in its order, in a folder that `conf.py` names. What the
commands leave there is what figures and examples are made of. A command that fails ends the build.
One that ends with ``&`` runs until its page ends. Python files next to the pages are there, too.
Nothing is run again as long as the pages and the program stay as they are.
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

PAGES = ("tutorial/command_line", "tutorial/service")
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


def fingerprint(sources: Path) -> str:
    """Digest of the commands and of the program that they run."""
    texts = ["\n".join(commands(text_of(sources, page))) for page in PAGES]
    texts += [path.read_text(encoding="utf-8") for path in scripts(sources)]
    digest = hashlib.sha256("\0".join(texts).encode())
    checkout = sources.parent
    for package in PACKAGES:
        for path in sorted((checkout / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def text_of(sources: Path, page: str) -> str:
    """Text of a page."""
    return (sources / f"{page}.md").read_text(encoding="utf-8")


def scripts(sources: Path) -> list[Path]:
    """Python files that the commands run."""
    return sorted((sources / "tutorial").glob("*.py"))


def shell(command: str) -> list[str]:
    """Return what runs a command line in which `spcola` and `python` are those of this process."""
    python = f'"{sys.executable}"'
    programs = f'spcola() {{ exec {python} -m fusion.cli "$@"; }}\npython() {{ {python} "$@"; }}\n'
    if not command.endswith("&"):
        programs = programs.replace("exec ", "")
    return ["bash", "-euc", programs + command.removesuffix("&")]


def run(command: str, folder: Path) -> str:
    """Run one command line in `folder` and return what it prints on standard output.

    Raises
    ------
    ExtensionError
        If it fails.
    """
    ended = subprocess.run(
        shell(command), cwd=folder, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    if ended.returncode:
        raise ExtensionError(f"{command!r} of the tutorial fails: {ended.stderr.strip()}")
    return ended.stdout.rstrip()


def run_page(text: str, folder: Path) -> list[str]:
    """Run the commands of a page; return what each prints."""
    printed, running = [], []
    try:
        for command in commands(text):
            logger.info("tutorial: %s", command)
            if command.endswith("&"):
                quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
                running.append(subprocess.Popen(shell(command), cwd=folder, **quiet))
            printed.append("" if command.endswith("&") else run(command, folder))
    finally:
        for process in running:
            process.terminate()
            process.wait(LIMIT_S)
    return printed


def run_all(app: Sphinx) -> None:
    """Run the tutorials, unless they were run as they are."""
    sources, folder = Path(app.srcdir), Path(app.config.TUTORIAL)
    done = folder / DONE
    mark = fingerprint(sources)
    if done.is_file() and json.loads(done.read_text(encoding="utf-8"))["of"] == mark:
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for script in scripts(sources):
        shutil.copy(script, folder)
    printed = {page: run_page(text_of(sources, page), folder) for page in PAGES}
    done.write_text(json.dumps({"of": mark, "printed": printed}), encoding="utf-8")


def shortened(text: str) -> str:
    """Return `text` with its middle left out where it is long."""
    lines = text.splitlines()
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 3], "…", *lines[-2:]]
    return "\n".join(lines)


def insert(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put below each command of the tutorial what it printed."""
    if docname not in PAGES:
        return
    done = json.loads((Path(app.config.TUTORIAL) / DONE).read_text(encoding="utf-8"))
    printed = iter(done["printed"][docname])

    def filled(match: re.Match[str]) -> str:
        lines = []
        for line in match.group(1).splitlines():
            lines.append(line)
            found = next(printed) if line.startswith("$ ") else ""
            lines += [shortened(found)] if found else []
        return "```console\n" + "\n".join(lines) + "\n```"

    source[0] = BLOCK.sub(filled, source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Run the commands before anything is read, and show what they print."""
    app.add_config_value("TUTORIAL", None, "")
    app.connect("builder-inited", run_all, priority=100)
    app.connect("source-read", insert)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
