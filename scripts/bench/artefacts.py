"""Digests of every file that missions `tiny` and `mini` leave: has a change moved a number?

The real commands make each mission and run all stages and one release. What is written down is a
digest of each file of the mission and of the workspace. Two programs that print the same digests
gave the same numbers to the bit. Left out are the catalogue (times of runs) and the pictures.
Text of reports and messages may change while numbers do not: `--numbers` digests JSON files by
their numbers alone.

    python scripts/bench/artefacts.py digests.json [--presets tiny mini] [--work DIR] [--numbers]
    python scripts/bench/artefacts.py --compare before.json after.json
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Times of runs; pictures and words of the report.
LEFT_OUT = {"catalog.sqlite", "catalog.sqlite-wal", "catalog.sqlite-shm", "report.html"}


def main() -> int:
    """Print digests, or compare two files of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--presets", nargs="+", default=["tiny", "mini"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--numbers", action="store_true")
    asked = parser.parse_args()
    if asked.compare:
        return compare(*asked.files)
    with tempfile.TemporaryDirectory() as made:
        work = asked.work or Path(made)
        found = {}
        for preset in asked.presets:
            folder = work / preset
            run_mission(folder, preset, asked.seed)
            found |= {
                f"{preset}/{path.relative_to(folder)}": digest(path, numbers=asked.numbers)
                for path in artefacts(folder)
            }
    asked.files[0].write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    print(f"{len(found)} digests in {asked.files[0]}")
    return 0


def run_mission(folder: Path, preset: str, seed: int) -> None:
    """Make the mission and run every stage, unless that was done before."""
    mission, workspace = folder / "mission", folder / "workspace"
    spcola("truth", "make", mission, "--preset", preset, "--seed", seed)
    spcola("init", workspace, "--spc", mission / "spc")
    spcola("import", workspace, *sorted((mission / "lidar").iterdir()))
    spcola("run", workspace)


def spcola(*arguments: object) -> None:
    """Run one command of the program; end with its message if it fails."""
    command = [sys.executable, "-m", "fusion.cli", *map(str, arguments)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise SystemExit(f"{' '.join(command[2:])}\n{ended.stderr}")


def artefacts(folder: Path) -> Iterator[Path]:
    """Yield what is compared."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in LEFT_OUT and path.suffix != ".lock":
            yield path


def digest(path: Path, *, numbers: bool) -> str:
    """Return the digest of a file; of a JSON file's numbers alone where that is asked."""
    if numbers and path.suffix == ".json":
        found = list(numbers_of(json.loads(path.read_text(encoding="utf-8"))))
        return hashlib.sha256(json.dumps(found).encode()).hexdigest()
    return hashlib.sha256(path.read_bytes()).hexdigest()


def numbers_of(value: Any) -> Iterator[Any]:
    """Yield the numbers of a JSON value, in the order of its keys."""
    if isinstance(value, dict):
        for key in sorted(value):
            yield from numbers_of(value[key])
    elif isinstance(value, list):
        for item in value:
            yield from numbers_of(item)
    elif not isinstance(value, str):
        yield value


def compare(before: Path, after: Path) -> int:
    """Print which files differ; return 1 if any does."""
    old, new = (json.loads(path.read_text(encoding="utf-8")) for path in (before, after))
    changed = [name for name in sorted(old.keys() & new.keys()) if old[name] != new[name]]
    print("\n".join(f"differs  {name}" for name in changed))
    print(
        "\n".join(
            f"{'gone   ' if name in old else 'new    '}  {name}"
            for name in sorted(old.keys() ^ new.keys())
        )
    )
    print(
        f"{len(old.keys() & new.keys()) - len(changed)} files are the same, {len(changed)} differ"
    )
    return int(bool(changed) or old.keys() != new.keys())


if __name__ == "__main__":
    raise SystemExit(main())
