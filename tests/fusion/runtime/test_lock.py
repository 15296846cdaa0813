"""Remains of killed programs are removed; files of running programs are kept."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from fusion.runtime.folders import clear_abandoned_folders


def test_hidden_folders_of_dead_processes_are_removed(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = [f".copy.{dead.pid}", f".copy.{os.getpid()}", ".copy.old", f".other.{dead.pid}"]
    for name in names:
        (tmp_path / name / "MAPFILES").mkdir(parents=True)
    clear_abandoned_folders(tmp_path / "copy")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])
