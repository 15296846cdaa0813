"""The program's commands in this process, for tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from fusion.cli.app import command_line

app = command_line()
ROOT = Path(__file__).resolve().parents[2]


def call(*arguments: object, code: int = 0) -> Result:
    """Run a command and check its exit code."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


def called(*arguments: object) -> Any:
    """Run a command with ``--json`` and return its object."""
    return json.loads(call(*arguments, "--json").stdout)


def refused(*arguments: object) -> str:
    """Run a command that must fail, and return its one line."""
    return line_of(call(*arguments, code=1))


def line_of(result: Result) -> str:
    """Return the one line that a refused command prints; standard output is empty."""
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    return result.stderr


def program(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """Start a real process."""
    return subprocess.Popen(
        [sys.executable, "-m", "fusion.cli", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        **options,
    )
