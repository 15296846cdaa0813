"""One program at a time; remains of killed programs are removed, files of running ones kept."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fusion.runtime.folders import clear_abandoned_folders, locked
from spcola.errors import WorkspaceError


def test_hidden_folders_of_dead_processes_are_removed(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = [f".copy.{dead.pid}", f".copy.{os.getpid()}", ".copy.old", f".other.{dead.pid}"]
    for name in names:
        (tmp_path / name / "MAPFILES").mkdir(parents=True)
    clear_abandoned_folders(tmp_path / "copy")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])


HOLDER = """
import sys, time
from pathlib import Path
from fusion.runtime.folders import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""


def test_a_second_program_is_refused_or_waits_until_the_first_is_done(tmp_path: Path) -> None:
    lock = tmp_path / ".lock"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(lock)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as first:  # fmt: skip
        assert first.stdout is not None
        assert first.stdin is not None
        assert first.stdout.readline() == "held\n"
        with pytest.raises(WorkspaceError, match="at work here"), locked(lock):
            pass
        with ThreadPoolExecutor(1) as pool:
            second = pool.submit(_hold, lock)
            with pytest.raises(TimeoutError):
                second.result(timeout=0.6)
            first.stdin.write("\n")
            first.stdin.flush()
            second.result(timeout=20.0)


def test_what_was_removed_by_another_program_is_not_locked(tmp_path: Path) -> None:
    folder = tmp_path / "solution"
    folder.mkdir()
    with ThreadPoolExecutor(1) as pool:
        with locked(folder / ".lock"):
            waiting = pool.submit(_hold, folder / ".lock")
            with pytest.raises(TimeoutError):
                waiting.result(timeout=0.4)
            folder.rename(tmp_path / "gone")
        with pytest.raises(WorkspaceError, match="removed by another"):
            waiting.result(timeout=20.0)


def _hold(lock: Path) -> None:
    with locked(lock, wait=True):
        pass
