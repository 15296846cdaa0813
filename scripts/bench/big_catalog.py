"""Time of `spcola info` of a workspace whose catalogue has very many items.

Makes a workspace of small maplets with all that stages leave for them: maplets, landmarks, mapolas,
fused maplets with their companions, kept items, and the records of finished stages. Then its
catalogue and settings are removed, and `spcola init` makes it anew over these files, as over any
folder of SPC. `spcola info --json` of it is timed in a process of its own, with the start of the
program: for the first time, again, after one file was written again, after a command, and after one
file was changed by hand, or removed; at last with nothing known, so that all is read. What
the file system takes alone is timed in the same way: a process that lists all files with their
states.

    python scripts/bench/big_catalog.py [--items 100000] [--folder DIR]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.pipeline import Pipeline, opened
from fusion.pipeline.catalog.records import RECORD_FOLDER, StageRecord
from fusion.pipeline.catalog.rows import CATALOG_FILE
from fusion.stages import load_stages
from fusion.workspace import SETTINGS_FILE, Workspace, new_workspace
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola import atomic
from spcola.control import Landmark
from spcola.formats.maplets import write_maplet
from spcola.formats.solution import write_landmark
from spcola.grids import Maplet, MapletGrid

LIMIT_S = 1.0
# Files and kept items for each maplet.
_FILES = 8
_RADIUS = 250.0
_LISTING = """
import os, sys
waiting = sys.argv[1:]
while waiting:
    with os.scandir(waiting.pop()) as entries:
        for entry in entries:
            entry.stat()
            if entry.is_dir():
                waiting.append(entry.path)
"""


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
        print(f"files listed with their states, nothing else: {seconds_of_listing(root)}")
        forget(root, SETTINGS_FILE)
        print(f"init over these files: {seconds_of('init', root, '--spc', root)}")
        times = Times(root)
        times.print("first time after init")
        times.print("again")
        path = root / "mapolas" / "A00001.MAP"
        content = path.read_bytes()
        atomic.write_bytes(path, content)
        times.print("after a file was written again")
        seconds_of("release", root)
        times.print("after a command")
        change(path)
        times.print("after a result was changed by hand")
        change(path.with_name("A00002.MAP"))
        times.print("after another one was changed")
        change(root / "MAPFILES" / "A00001.MAP")
        times.print("after a maplet was changed by hand")
        change(root / "MAPFILES" / "A00002.MAP")
        times.print("after another one was changed")
        times.print("again")
        path.unlink()
        times.print("after a result was removed", limited=False)
        atomic.write_bytes(path, content)
        times.print("after it was brought back", limited=False)
        forget(root)
        times.print("with nothing known: all is read", limited=False)
        print(f"files listed with their states, nothing else: {seconds_of_listing(root)}")


@dataclass(frozen=True)
class Times:
    """Prints how long `spcola info` of a workspace takes."""

    root: Path

    def print(self, when: str, *, limited: bool = True) -> None:
        limit = f" (limit {LIMIT_S:g} s)" if limited else ""
        print(f"info, {when}: {seconds_of('info', self.root, '--json')}{limit}")


def forget(root: Path, *more: str) -> None:
    """Remove the catalogue, what commands remember of the workspace, and further files."""
    for name in (CATALOG_FILE, *more):
        (root / name).unlink()
    for path in (root / RECORD_FOLDER).glob(".*"):
        path.unlink()


def fill(workspace: Workspace, items: int) -> None:
    """Write maplets, and copies of their files under the names that stages give.

    For each maplet there are seven files and a kept item: its .MAP, landmark, mapola, fused map
    with its sigma, and files of a release.
    """
    home, count = workspace.home, items // _FILES
    names = [f"A{number:05d}" for number in range(count)]
    turns = np.random.default_rng(1).normal(size=(count, 3))
    for name, up in zip(names, turns / np.linalg.norm(turns, axis=1, keepdims=True), strict=True):
        grid = MapletGrid.facing(_RADIUS * up, up, 0.5, 2)
        flat = Maplet(name, grid, np.zeros(grid.shape), center_sigma=np.full(3, 0.1))
        write_maplet(home / "MAPFILES" / f"{name}.MAP", flat)
        write_landmark(home / "LMKFILES" / f"{name}.LMK", Landmark(name, grid, flat.center_sigma))
        content = (home / "MAPFILES" / f"{name}.MAP").read_bytes()
        for path in _made_of(home, name):
            path.write_bytes(content)
    write_scan(home / "scans" / "one.h5", [Scan.of_points("one", _RADIUS * turns[:100])])
    (home / "fused" / "fused.h5").write_bytes(b"made up")
    workspace.write_json("registration.json", {"verdict": "accepted"})
    record_all(workspace)


def _made_of(home: Path, name: str) -> list[Path]:
    """Return the files that stages make of one maplet, with its kept item."""
    for folder in (".items/fuse", "release"):
        (home / folder).mkdir(parents=True, exist_ok=True)
    made = [f"mapolas/{name}.MAP", f"fused/{name}.MAP", f"fused/{name}.SIG"]
    made += [f"release/{name}.MAP", f"release/{name}.SIG", f".items/fuse/{name}.npz"]
    return [home / path for path in made]


def record_all(workspace: Workspace) -> None:
    """Record all stages that have their inputs as just run."""
    stages, settings = load_stages(), workspace.settings()
    pipeline = Pipeline(workspace, settings, stages)
    with opened(workspace) as catalog:
        for stage in stages:
            if stage.missing(workspace, settings):
                continue
            key = pipeline._key(stage, catalog)
            files = [path for place in stage.places for path in _files(workspace.home / place)]
            outputs = catalog.digests(files)
            catalog.store(
                StageRecord(
                    stage.name, key.digest, key.version, key.settings, key.inputs, outputs, {}, ""
                )
            )


def _files(place: Path) -> list[Path]:
    return [place] if place.is_file() else sorted(place.iterdir()) if place.is_dir() else []


def change(path: Path) -> None:
    """Change the last byte of a file."""
    content = path.read_bytes()
    atomic.write_bytes(path, content[:-1] + bytes([content[-1] ^ 1]))


def seconds_of(*arguments: object) -> str:
    """Run a command of the program in a process of its own; return how long it took."""
    return _seconds([sys.executable, "-m", "fusion.cli", *map(str, arguments)])


def seconds_of_listing(root: Path) -> str:
    """Return how long a process takes that asks for the states of all files."""
    return _seconds([sys.executable, "-c", _LISTING, str(root)])


def _seconds(program: list[str]) -> str:
    begun, before = time.perf_counter(), os.times()
    subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
    now = os.times()
    used = now.children_user + now.children_system - before.children_user - before.children_system
    return f"{time.perf_counter() - begun:.2f} s, {used:.2f} s of processor time"


if __name__ == "__main__":
    main()
