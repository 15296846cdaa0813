"""Worker processes are started again when they end, killed when they hang, and drained."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from fusion.service.work import Supervisor

WORKER = """
import os, signal, sys, time
from pathlib import Path
folder, name, life, beats = sys.argv[1:]
def drained(*_):
    Path(folder, "drained").touch()
    # The second one takes too long.
    if Path(folder, "second").exists():
        time.sleep(60)
    sys.exit(0)
signal.signal(signal.SIGTERM, drained)
turn = len(list(Path(folder).glob("begun *")))
Path(folder, f"begun {name}").touch()
if turn == 0:
    os._exit(3)
while True:
    if turn > 1:
        os.write(int(beats), b".")
    time.sleep(0.05)
"""


def test_workers_are_started_again_and_drained(tmp_path: Path) -> None:
    lost: list[str] = []
    command = [sys.executable, "-c", WORKER, str(tmp_path)]
    supervisor = Supervisor(command, 1, lost=lost.append, drain_s=10.0, silent_s=0.7)
    supervisor.start()
    until = time.monotonic() + 30
    # The first ends at once, the second gives no sign of life.
    while len(list(tmp_path.glob("begun *"))) < 3 and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(1.0)
    begun = {path.name.removeprefix("begun ") for path in tmp_path.glob("begun *")}
    assert len(begun) == 3
    assert set(lost) < begun
    assert set(supervisor.workers) == begun - set(lost)
    supervisor.stop()
    assert (tmp_path / "drained").exists()
    assert len(lost) == 2


def test_a_worker_that_drains_too_slowly_is_killed(tmp_path: Path) -> None:
    (tmp_path / "begun before").touch()
    (tmp_path / "begun long before").touch()
    (tmp_path / "second").touch()
    lost: list[str] = []
    supervisor = Supervisor(
        [sys.executable, "-c", WORKER, str(tmp_path)], 1, lost=lost.append, drain_s=0.5
    )
    supervisor.start()
    until = time.monotonic() + 30
    while len(list(tmp_path.glob("begun *"))) < 3 and time.monotonic() < until:
        time.sleep(0.05)
    (name,) = supervisor.workers
    begun = time.monotonic()
    supervisor.stop()
    assert time.monotonic() - begun < 20
    assert (tmp_path / "drained").exists()
    assert lost == [name]
