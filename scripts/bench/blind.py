"""What it takes to make a blind mission and to begin with it: time and memory with the limits.

The real command line makes the mission, makes a workspace of its coarse shape and imports its
scans.

    python scripts/bench/blind.py [--preset blind-small] [--seed 1] [--work DIR]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Limits of `blind-small`: seconds of all commands, and gigabytes of the largest.
MOST_SECONDS, MOST_GB = 180.0, 2.0


def main() -> int:
    """Run the commands and print what each took."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--preset", default="blind-small")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        work = asked.work or Path(made)
        mission, workspace = work / "mission", work / "workspace"
        commands = [
            ("truth", "make", mission, "--preset", asked.preset, "--seed", asked.seed),
            ("init", workspace, "--shape", mission / "shape" / "rough.obj"),
            ("import", workspace, None),
        ]
        total, largest = 0.0, 0.0
        for command in commands:
            words = [str(word) for word in command if word is not None]
            if None in command:
                words += [str(path) for path in sorted((mission / "lidar").iterdir())]
            seconds, gigabytes = taken(words)
            total, largest = total + seconds, max(largest, gigabytes)
            print(f"{' '.join(words[:2]):<24} {seconds:7.1f} s {gigabytes:6.2f} GB")
    print(f"{'all':<24} {total:7.1f} s {largest:6.2f} GB")
    if asked.preset != "blind-small":
        return 0
    print(f"{'limit':<24} {MOST_SECONDS:7.1f} s {MOST_GB:6.2f} GB")
    return int(total > MOST_SECONDS or largest > MOST_GB)


def taken(words: list[str]) -> tuple[float, float]:
    """Return seconds and gigabytes of a command."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "fusion.cli", *words], stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(process.returncode)
    return time.perf_counter() - start, usage.ru_maxrss / 1e6


if __name__ == "__main__":
    sys.exit(main())
