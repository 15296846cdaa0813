"""Whether the number of cores changes any bit: one mission, processed in several ways.

Each way imports and runs the same mission by the real commands, in separate processes: with
one, two or three workers, on one core or all, with one thread or two for Numba, OpenMP and BLAS.
Then every file of the workspaces is compared, byte by byte; of provenance/ without the time of day,
and without catalog.sqlite, which has the content of provenance/ in the order of its writing.

Printed: for each way its time and the files that differ from those of the first. Ends with 1 if
any does.

    python scripts/bench/cores.py [--preset tiny] [--seed 3] [--mission DIR] [--work DIR]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

NAMES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
WAYS: tuple[tuple[str, int, bool, int], ...] = (
    # name, workers, one core only, threads of the libraries
    ("one core", 1, True, 1),
    ("all cores, one worker", 1, False, 1),
    ("two workers, two threads", 2, False, 2),
    ("three workers, two threads", 3, False, 2),
    ("three workers, one core", 3, True, 2),
)


def command(words: list[str], *, one_core: bool = False, threads: int = 1) -> None:
    """Run a command of spcola; an error ends the script."""

    def confine() -> None:
        if one_core:
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

    subprocess.run(
        [sys.executable, "-m", "fusion.cli", *words],
        check=True,
        env={**os.environ, **dict.fromkeys(NAMES, str(threads))},
        preexec_fn=confine,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def contents(root: Path) -> dict[str, bytes]:
    """Return every file of a workspace that must be equal between runs."""
    found = {}
    for path in sorted(path for path in root.rglob("*") if path.is_file()):
        name = path.relative_to(root)
        if path.parent.name == "provenance":
            record = json.loads(path.read_text(encoding="utf-8"))
            del record["finished"]
            found[str(name)] = json.dumps(record, sort_keys=True).encode()
        elif path.name not in ("catalog.sqlite", ".lock"):
            found[str(name)] = path.read_bytes()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--mission", type=Path, help="one that is there; else it is made")
    parser.add_argument("--work", type=Path, help="kept; else a temporary folder")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = given.work or Path(temporary)
        mission = given.mission or work / "mission"
        if given.mission is None:
            made = ["truth", "make", str(mission), "--preset", given.preset]
            command([*made, "--seed", str(given.seed)])
        scans = [str(path) for path in sorted((mission / "lidar").iterdir())]
        # Some products contain the path of the workspace.
        root, first, differ = work / "workspace", dict[str, bytes](), 0
        for name, workers, one_core, threads in WAYS:
            begun = time.monotonic()
            command(["init", str(root), "--spc", str(mission / "spc"), "--body", "Truth"])
            how = ["--workers", str(workers)]
            command(["import", str(root), *scans, *how], one_core=one_core, threads=threads)
            command(["run", str(root), *how], one_core=one_core, threads=threads)
            found = contents(root)
            first = first or found
            other = sorted(
                path for path in first.keys() | found.keys() if first.get(path) != found.get(path)
            )
            differ += len(other)
            took = time.monotonic() - begun
            print(f"{name:28}{took:7.1f} s  {len(found)} files, {len(other)} differ", *other[:5])
            root.rename(work / f"workspace {name}")
    sys.exit(1 if differ else 0)


if __name__ == "__main__":
    main()
