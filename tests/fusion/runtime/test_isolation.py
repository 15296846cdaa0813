"""A command in a process of its own: its result, and what becomes of its death."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import app
from typer.testing import CliRunner

from fusion.runtime.processes import ProcessLimits, isolated
from spcola.errors import InvalidValueError, SpcolaError

ROOT = Path(__file__).resolve().parents[3]


def child(folder: Path, script: str) -> str:
    """Return a program that stands for Python, and does something else."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("script", "seconds", "message"),
    [
        ("kill -ABRT $$", 60, r"the reader ended by signal 6 \(SIGABRT\)"),
        ("kill -SEGV $$", 60, r"the reader ended by signal 11 \(SIGSEGV\)"),
        ("exec sleep 60", 1, "the reader took more than 1 s"),
    ],
)
def test_the_death_of_the_child_is_one_line_and_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, seconds: float, message: str
) -> None:
    work = tmp_path / "ws"
    (work / "scans").mkdir(parents=True)
    (work / "scans" / ".before.h5.1.part").write_text("of another process")
    (work / "scans" / "whole.h5").write_text("whole")
    half = f"touch {work}/scans/.new.h5.2.part; echo 'memory allocation failed' >&2; "
    monkeypatch.setattr(sys, "executable", child(tmp_path, half + script))
    with pytest.raises(SpcolaError, match=rf"spcola import: {message}") as caught:
        isolated(["import", "ws", "a.laz"], ProcessLimits(seconds=seconds), work)
    assert "\n" not in str(caught.value)
    assert sorted(p.name for p in work.rglob("*.*")) == [".before.h5.1.part", "whole.h5"]


def test_limits_that_are_none_are_refused() -> None:
    for values in ({"memory_mb": 100}, {"seconds": 0.0}, {"seconds": float("nan")}):
        with pytest.raises(InvalidValueError, match="--limit"):
            ProcessLimits(**values)


LIMITED = """
import os, resource
os.environ["SPCOLA_LIMITS"] = "4096 100"
import fusion.cli.app
from fusion.runtime.processes.isolation import apply_limits
apply_limits()
assert "SPCOLA_LIMITS" not in os.environ
assert resource.getrlimit(resource.RLIMIT_AS)[0] == 4096 << 20
assert resource.getrlimit(resource.RLIMIT_CORE)[0] == 0
assert 0 < resource.getrlimit(resource.RLIMIT_CPU)[0] <= 100 * os.cpu_count()
try:
    bytearray(5 << 30)
except MemoryError:
    print("no room")
"""


def test_a_child_keeps_its_limits() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", LIMITED], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout == "no room\n"


def test_a_command_prints_the_same_in_a_child(tmp_path: Path) -> None:
    for name, text in (("a.json", '{"a": 1}'), ("bad.json", "{")):
        path = tmp_path / name
        path.write_text(text)
        plain = CliRunner().invoke(app, ["info", str(path), "--json"])
        apart = subprocess.run(
            [sys.executable, "-m", "fusion.cli", "info", str(path), "--json", "--isolate"],
            capture_output=True,
            text=True,
            check=False,
            cwd=ROOT,
        )
        assert apart.returncode == plain.exit_code
        assert (apart.stdout, apart.stderr) == (plain.stdout, plain.stderr)
