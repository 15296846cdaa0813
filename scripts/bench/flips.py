"""Effects of flipped bits in results of a finished workspace, and in headers of its maplets.

Each flip is followed by a command: the stage that reads the file, or `run`. Outcomes:

- `refused`: one line, exit 1, and all results unchanged;
- `healed`: the command succeeded, and all results have the same numbers as before;
- `no effect`: no command reads the flipped bit, and nothing else differs;
- `WRONG`: anything else: another number, an unexpected message, a command that hangs.

The workspace is copied first, and restored after each flip.

    python scripts/bench/flips.py WORKSPACE [--flips 1000] [--seed 0] [--runs 0.15] [--headers]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from typer.testing import CliRunner, Result

from fusion.cli.app import command_line
from fusion.pipeline.catalog.soundness import unsound_maplets
from fusion.workspace import Workspace
from spcola.errors import SpcolaError
from spcola.formats.maplets import read_map

KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "scans": ("scans/*.h5", ("mapolas", "scale", "bigmap")),
    "mapolas.h5": ("mapolas/mapolas.h5", ("register", "fuse")),
    "adjustment.h5": ("mapolas/adjustment.h5", ("register",)),
    "mapola maps": ("mapolas/*.MAP", ("register", "fuse")),
    "registration": ("registration.json", ("fuse", "bigmap", "scale")),
    "fused.h5": ("fused/fused.h5", ("bigmap", "release")),
    "fused maps": ("fused/*.MAP", ("bigmap", "release")),
    "bigmaps": ("bigmaps/**/*.*", ("release",)),
    "scale": ("scale.json", ("release",)),
    "pairs": ("pairs/*.MAP", ("release",)),
    "release": ("release/*.*", ("release",)),
    "report": ("report.html", ("release",)),
    "records": ("provenance/*.json", ("register", "release")),
    "catalogue": ("catalog.sqlite", ("register", "release")),
}
"""Kind → its files, and the commands of the stages that read them."""

# Not results: the index, its lock, and the records of runs, which include their times.
ASIDE = ("catalog.sqlite", ".lock", ".scratch", "provenance")
# Keys of JSON results about the run, not the body.
VOLATILE = ("made_by", "key", "finished", "seconds")
LIMIT_S = 120
_HEAD = 4096
# The first six bytes of a .MAP are unused.
HEADER_BITS = range(48, 576)


@dataclass(frozen=True)
class Flip:
    """One bit of one file, and the command that follows."""

    kind: str
    name: str
    bit: int
    command: str


class Bench:
    """A finished workspace that is damaged and restored."""

    def __init__(self, finished: Path, folder: Path) -> None:
        self.good, self.root = folder / "good", folder / "ws"
        # Without links: the files they lead to must not be damaged.
        shutil.copytree(finished, self.good)
        shutil.copytree(self.good, self.root)
        self._call("run")
        shutil.rmtree(self.good)
        shutil.copytree(self.root, self.good)
        self.stats = self._look()
        self.numbers = {name: numbers(self.good / name) for name in self.stats}

    def flips(self, count: int, seed: int, runs: float) -> Iterator[Flip]:
        """Choose flips: equally many of each kind, half of them at the beginning of the file."""
        rng = np.random.default_rng(seed)
        kinds = [kind for kind in KINDS if self._files(kind)]
        for number in range(count):
            kind = kinds[number % len(kinds)]
            name = str(rng.choice(self._files(kind)))
            size = (self.good / name).stat().st_size
            place = int(rng.integers(min(size, _HEAD) if rng.random() < 0.5 else size))
            command = "run" if rng.random() < runs else str(rng.choice(KINDS[kind][1]))
            yield Flip(kind, name, 8 * place + int(rng.integers(8)), command)

    def outcome(self, flip: Flip) -> tuple[str, str]:
        """Damage a file, run the command, compare, and restore everything."""
        path = self.root / flip.name
        content = bytearray(path.read_bytes())
        content[flip.bit // 8] ^= 1 << (flip.bit % 8)
        # In place, as by a disk error: the time of writing is set back.
        before = path.stat()
        with path.open("r+b") as stream:
            stream.write(content)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        try:
            with limited():
                result = self._call(flip.command)
            return self._judged(flip, result)
        except TimeoutError:
            return "WRONG", "took too long"
        finally:
            self._restore()

    def _judged(self, flip: Flip, result: Result) -> tuple[str, str]:
        line = result.stderr.strip().splitlines()[-1] if result.stderr.strip() else ""
        changed = self._changed() - {flip.name}
        if changed:
            return "WRONG", f"{sorted(changed)[:3]} differ; {line}"
        if result.exit_code not in (0, 1) or "unexpected" in line or _is_crash(result):
            return "WRONG", f"exit {result.exit_code}: {line}"
        if result.exit_code == 1:
            return "refused", line
        if flip.name.split("/")[0] in ASIDE:
            return "no effect", ""
        same = numbers(self.root / flip.name) == self.numbers[flip.name]
        if same:
            return "healed", ""
        read = flip.command == "run" or flip.command == KINDS[flip.kind][1][0]
        return ("WRONG", "remains damaged") if read else ("no effect", "")

    def _call(self, command: str) -> Result:
        return CliRunner().invoke(command_line(), [command, str(self.root), "--json"])

    def _files(self, kind: str) -> list[str]:
        found = sorted(self.good.glob(KINDS[kind][0]))
        return [str(path.relative_to(self.good)) for path in found if path.is_file()]

    def _look(self) -> dict[str, tuple[int, int, int]]:
        found = {}
        for path in self.root.rglob("*"):
            name = path.relative_to(self.root)
            if path.is_file() and name.parts[0] not in (".lock", ".scratch"):
                state = path.stat()
                found[str(name)] = (state.st_ino, state.st_ctime_ns, state.st_size)
        return found

    def _changed(self) -> set[str]:
        """Return results that have other numbers than before, or are gone, or new."""
        now = self._look()
        differing = {
            name
            for name, state in now.items()
            if self.stats.get(name) != state
            and name.split("/")[0] not in ASIDE
            and numbers(self.root / name) != self.numbers.get(name)
        }
        return differing | (self.stats.keys() - now.keys())

    def _restore(self) -> None:
        now = self._look()
        for name in now.keys() - self.stats.keys():
            (self.root / name).unlink()
        for name, state in self.stats.items():
            if now.get(name) != state:
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(self.good / name, self.root / name)
        self.stats = self._look()


def _is_crash(result: Result) -> bool:
    return result.exception is not None and not isinstance(result.exception, SystemExit)


@contextmanager
def limited() -> Iterator[None]:
    """Raise TimeoutError in code that takes too long."""

    def end(*_: object) -> None:
        raise TimeoutError

    former = signal.signal(signal.SIGALRM, end)
    signal.alarm(LIMIT_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, former)


def numbers(path: Path) -> Any:
    """Return the content of a file about the body, without when and where it was made."""
    content = path.read_bytes()
    try:
        if path.suffix == ".json":
            return _without(json.loads(content), VOLATILE)
        if path.suffix == ".h5":
            with h5py.File(path, "r") as file:
                return _of_hdf5(file)
    except Exception:
        pass
    return hashlib.sha256(content).hexdigest()


def _without(value: Any, keys: Sequence[str]) -> Any:
    if isinstance(value, dict):
        return {key: _without(item, keys) for key, item in value.items() if key not in keys}
    return [_without(item, keys) for item in value] if isinstance(value, list) else value


def _of_hdf5(file: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"/": sorted((k, repr(v)) for k, v in file.attrs.items())}

    def add(name: str, node: Any) -> None:
        found[name] = sorted((key, repr(value)) for key, value in node.attrs.items())
        if isinstance(node, h5py.Dataset):
            found[f"{name}="] = hashlib.sha256(np.asarray(node[()]).tobytes()).hexdigest()
            if node.dtype.kind == "O":
                found[f"{name}="] = repr(node[()])

    file.visititems(add)
    return found


def headers(finished: Path, folder: Path) -> Counter[str]:
    """Flip each bit of the header of one maplet, and count what detects it."""
    root = folder / "headers"
    shutil.copytree(finished, root, ignore=shutil.ignore_patterns("release", "scans", "fused"))
    workspace = Workspace.open(root)
    name = workspace.maplet_names()[len(workspace.maplet_names()) // 4]
    path = workspace.maplet_path(name)
    good, before = path.read_bytes(), read_map(path).maplet
    found = Counter[str]()
    for bit in HEADER_BITS:
        content = bytearray(good)
        content[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(content)
        found[_of_header(workspace, name, before)] += 1
    return found


def _of_header(workspace: Workspace, name: str, before: Any) -> str:
    try:
        maplet = read_map(workspace.maplet_path(name)).maplet
    except SpcolaError:
        return "refused by the reader"
    moved = float(np.nanmax(np.abs(maplet.points() - before.points())))
    if moved == 0.0 and np.array_equal(maplet.center_sigma, before.center_sigma, equal_nan=True):
        return "no effect"
    if any(one.name == name for one in unsound_maplets(workspace)):
        return "refused by comparison with other files"
    if moved == 0.0:
        return "passes, sigma differs"
    return f"passes, moving points by {10.0 ** np.ceil(np.log10(moved)):g} m at most"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--flips", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", type=float, default=0.15)
    parser.add_argument("--headers", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="flips.") as folder:
        if options.headers:
            for what, count in sorted(headers(options.workspace, Path(folder)).items()):
                print(f"{count:5d}  {what}")
            return
        bench, table = Bench(options.workspace, Path(folder)), Counter[tuple[str, str]]()
        for number, flip in enumerate(bench.flips(options.flips, options.seed, options.runs), 1):
            outcome, why = bench.outcome(flip)
            table[flip.kind, outcome] += 1
            if outcome == "WRONG":
                print(f"WRONG: {flip}: {why}", flush=True)
            if number % 50 == 0 or number == options.flips:
                show(table)


def show(table: Counter[tuple[str, str]]) -> None:
    outcomes = ("healed", "refused", "no effect", "WRONG")
    print(f"{'':16s}" + "".join(f"{outcome:>12s}" for outcome in outcomes))
    for kind in (*KINDS, None):
        row = [
            sum(n for (k, o), n in table.items() if o == outcome and kind in (k, None))
            for outcome in outcomes
        ]
        print(f"{kind or 'all':16s}" + "".join(f"{number:12d}" for number in row), flush=True)


if __name__ == "__main__":
    main()
