"""Digests of every file of missions `tiny` and `mini`: whether a change of code changed a number.

The real commands make each mission and run all stages and one release. A digest of each file of the
mission and of the workspace is written. Equal digests mean bit-identical numbers. Left out are
records of runs (times, folders) and the pictures.
Text of reports and messages may change while numbers do not: `--numbers` digests JSON files and
products by their numbers alone; `--made` digests what an earlier run left in DIR.

    python scripts/bench/artefacts.py digests.json [--presets tiny] [--work DIR] [--made]
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

import h5py
import numpy as np
import rasterio
from astropy.io import fits

# Times of runs; pictures and text of the report; a digest of digests; finished items.
LEFT_OUT = (
    "catalog.sqlite*",
    "report.html",
    "provenance/*.json",
    "*.lock",
    "release/manifest.json",
    ".items/*/*.npz",
)
# Keys with the folder in which a mission was made.
FOLDERS = {"made_by", "parameters", "seal"}


def main() -> int:
    """Print digests, or compare two files of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--presets", nargs="+", default=["tiny", "mini"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--made", action="store_true")
    parser.add_argument("--numbers", action="store_true")
    asked = parser.parse_args()
    if asked.compare:
        return compare(*asked.files)
    with tempfile.TemporaryDirectory() as made:
        work = asked.work or Path(made)
        found = {}
        for preset in asked.presets:
            folder = work / preset
            if not asked.made:
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
    """Yield the files that are compared."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(path.match(pattern) for pattern in LEFT_OUT):
            yield path


def digest(path: Path, *, numbers: bool) -> str:
    """Return the digest of a file; of its numbers alone where that is asked."""
    if path.suffix == ".h5":
        return digest_of_hdf5(path)
    if path.suffix == ".json" and path.parent.name != "mission":
        content = json.loads(path.read_text(encoding="utf-8"))
        content = {key: value for key, value in content.items() if key not in FOLDERS}
        found = list(numbers_of(content)) if numbers else content
        return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()
    return hashlib.sha256(data_of(path) if numbers else path.read_bytes()).hexdigest()


def data_of(path: Path) -> bytes:
    """Return the data of a product without its header, which has the digests of its inputs."""
    if path.suffix == ".fits":
        return np.asarray(fits.getdata(path)).tobytes()
    if path.suffix == ".tif":
        with rasterio.open(path) as source:
            layers: bytes = source.read().tobytes()
            return layers
    content = path.read_bytes()
    if path.suffix == ".ply":
        return content[content.index(b"end_header") :]
    if path.suffix in (".obj", ".toml"):
        return b"".join(line for line in content.splitlines() if line[:1] != b"#")
    return content


def digest_of_hdf5(path: Path) -> str:
    """Return the digest of all data sets and attributes but those that name a folder."""
    found = hashlib.sha256()

    def add(name: str, node: h5py.Dataset | h5py.Group) -> None:
        found.update(name.encode())
        for key in sorted(node.attrs.keys() - FOLDERS):
            found.update(key.encode() + np.asarray(node.attrs[key]).tobytes())
        if isinstance(node, h5py.Dataset):
            found.update(str(node.dtype).encode() + np.asarray(node[()]).tobytes())

    with h5py.File(path) as file:
        add("/", file)
        file.visititems(add)
    return found.hexdigest()


def numbers_of(value: Any) -> Iterator[Any]:
    """Yield the numbers of a JSON value, in the order of its keys."""
    if isinstance(value, dict):
        for key in sorted(value):
            yield from numbers_of(value[key])
    elif isinstance(value, list):
        for item in value:
            yield from numbers_of(item)
    elif value is not None and not isinstance(value, str):
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
