"""Kills a run of all stages at random moments, and compares the end with an undisturbed run.

    python scripts/bench/kills.py [--kills 20] [--preset tiny] [--seed 3] [--work DIR]

Printed: after each kill what the run had finished, and at the end how many files of the results
differ from those of a run that was not killed (the limit: 0), and how many finished items were
lost (the limit: 0; of those in work one for each worker).
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from fusion.pipeline.catalog import file_digest

RESULTS = ("mapolas", "fused", "bigmaps", "pairs", "release", "registration.json", "scale.json")
SPCOLA = [sys.executable, "-m", "fusion.cli"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--work", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench(options.work or Path(folder), options)


def bench(work: Path, options: argparse.Namespace) -> None:
    """Make a mission, run it undisturbed and killed, and compare."""
    mission, plain, killed = work / "mission", work / "plain", work / "killed"
    run("truth", "make", mission, "--preset", options.preset, "--seed", options.seed)
    run("init", plain, "--spc", mission / "spc", "--body", "Truth")
    run("import", plain, *sorted((mission / "lidar").iterdir()))
    shutil.copytree(plain, killed, symlinks=True)
    begun = time.monotonic()
    run("run", plain)
    whole = time.monotonic() - begun
    print(f"undisturbed: {whole:.0f} s, {len(digests(plain))} files")
    draw, lost = np.random.default_rng(options.seed), 0
    for number in range(options.kills):
        before = items(killed)
        wait = float(draw.uniform(1.0, 0.35 * whole))
        ended = interrupted(killed, wait)
        lost += len(before - items(killed)) if not ended else 0
        print(
            f"kill {number + 1:2d} after {wait:5.1f} s: {len(items(killed))} items kept, "
            f"{len(digests(killed))} files{' (it had ended)' if ended else ''}"
        )
    run("run", killed)
    one, two = digests(plain), digests(killed)
    differing = {name for name in one.keys() | two.keys() if one.get(name) != two.get(name)}
    print(f"files that differ: {len(differing)} of {len(one)} {sorted(differing)[:3]}")
    print(f"finished items lost: {lost}")
    print(f"temporary files left: {sum(1 for _ in killed.rglob('.*.part'))}")


def interrupted(workspace: Path, seconds: float) -> bool:
    """Run all stages and kill the process after some seconds; return whether it had ended."""
    process = subprocess.Popen(
        [*SPCOLA, "run", str(workspace)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return False
    return True


def items(workspace: Path) -> set[str]:
    """Names of the items that are kept of stages that have not ended."""
    return {path.name for path in (workspace / ".items").glob("*/*.npz")}


def digests(workspace: Path) -> dict[str, str]:
    """Digest of every result."""
    roots = [workspace / name for name in RESULTS]
    files = [path for root in roots for path in ([root] if root.is_file() else root.rglob("*"))]
    return {str(p.relative_to(workspace)): file_digest(p) for p in files if p.is_file()}


def run(*arguments: object) -> None:
    """Run a command to its end."""
    subprocess.run(
        [*SPCOLA, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip


if __name__ == "__main__":
    main()
