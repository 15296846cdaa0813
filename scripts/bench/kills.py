"""Kills commands at random moments, and compares the end with an undisturbed run.

    python scripts/bench/kills.py [--kills 20] [--preset tiny] [--seed 3] [--work DIR]
        [--only run|images|apply|export]

All stages, the import of images with states, `scale --apply` and `solution export`. Printed: after
each kill what was finished, and at the end how many files of the results differ from those of a
run that was not killed (the limit: 0), how many finished items were lost (the limit: 0; of those in
work one for each worker), and how often half of a solution or folder stood under its name (0).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from images import make_different

from fusion.pipeline.catalog import file_digest

SPCOLA = [sys.executable, "-m", "fusion.cli"]
STAGES = ("mapolas", "fused", "bigmaps", "pairs", "release", "registration.json", "scale.json")
IMAGES = ("IMAGEFILES", "SUMFILES", "NOMINALS", "PICTLIST.TXT", "images.jsonl")
ITEMS = (".items/*/[!.]*.npz",)
# Notes of runs and of solutions, and what they have of when and by which job they were made.
TIMED = {
    "provenance": ("finished", "checksum"),
    "solution.json": ("made", "effort", "job", "checksum"),
}
# Nor which job removed a solution.
INDEX = ("catalog.sqlite", ".lock", ".removed.json", ".maplets", ".coverage-", ".overview-")


@dataclass(frozen=True)
class Attack:
    """A command that is run undisturbed and killed.

    Attributes
    ----------
    title : str
    words : tuple
        The command and its arguments; ``{}`` stands for the folder that it works on.
    results : tuple of str
        What is compared: files and folders below that folder.
    kept : tuple of str
        Patterns of the files that finished items leave, none of which may be lost.
    whole : bool
        Whether the results stand under their name only when all are there.
    """

    title: str
    words: tuple[object, ...]
    results: tuple[str, ...]
    kept: tuple[str, ...] = ()
    whole: bool = False

    def command(self, folder: Path) -> list[str]:
        return [*SPCOLA, *(str(word).replace("{}", str(folder)) for word in self.words)]

    def digests(self, folder: Path) -> dict[str, str]:
        return digests_of(folder, self.results)

    def items(self, folder: Path) -> set[Path]:
        return {path for pattern in self.kept for path in folder.glob(pattern)}


def digests_of(folder: Path, results: Sequence[str] = (".",)) -> dict[str, str]:
    """Return the digest of each file of some results by its path in a folder, but for times.

    Indices of files, with their times and places on the disk, are no results.
    """
    roots = [folder / name for name in results]
    files = [path for root in roots for path in ([root] if root.is_file() else root.rglob("*"))]
    return {
        str(path.relative_to(folder)): timeless_digest(path)
        for path in files
        if path.is_file() and not path.name.startswith(INDEX)
    }


def timeless_digest(path: Path) -> str:
    """Return the digest of a file; of a note, without the time at which it was made."""
    timed = TIMED.get(path.name) or TIMED.get(path.parent.name)
    if timed is None:
        return file_digest(path)
    content = json.loads(
        path.read_text(),
        object_hook=lambda found: {key: one for key, one in found.items() if key not in timed},
    )
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def differing(one: Mapping[str, str], two: Mapping[str, str]) -> list[str]:
    """Return the files that are not the same, or in one only."""
    return sorted(name for name in one.keys() | two.keys() if one.get(name) != two.get(name))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--work", type=Path)
    every = ["run", "images", "apply", "export"]
    parser.add_argument("--only", nargs="*", choices=every, default=every)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench(options.work or Path(folder), options)


def bench(work: Path, options: argparse.Namespace) -> None:
    """Make a mission and images, and attack each command in turn."""
    rng, mission, begin = np.random.default_rng(options.seed), work / "mission", work / "begin"
    run("truth", "make", mission, "--preset", options.preset, "--seed", options.seed)
    run("init", begin, "--spc", mission / "spc", "--body", "Truth")
    run("import", begin, *sorted((mission / "lidar").iterdir()))
    done = begin
    if set(options.only) & {"run", "apply", "export"}:
        done = attacked(Attack("run", ("run", "{}"), STAGES, ITEMS), begin, rng, options)
    if "images" in options.only:
        attacked(importing(work), begin, rng, options)
    accepted = ("--accept", "epsilon-not-significant", "--accept", "epsilon-not-separable")
    for title, words, result in (
        ("apply", ("scale", "{}", "--apply", "--as", "scaled", *accepted), "solutions/scaled"),
        ("export", ("solution", "export", "{}", "imported", "{}/exported"), "exported"),
    ):
        if title in options.only:
            attacked(Attack(title, words, (result,), whole=True), done, rng, options)


def importing(work: Path) -> Attack:
    """Return the import of 240 images with states from a table."""
    source = work / "images"
    source.mkdir()
    paths, table, camera = make_different(source, 240, 512)
    words = ("images", "{}", *paths, "--poses", table, "--camera", camera, "--workers", 2)
    return Attack("images", words, IMAGES, (".items/images/*.npz", "IMAGEFILES/*.DAT"))


def attacked(
    attack: Attack, begin: Path, rng: np.random.Generator, options: argparse.Namespace
) -> Path:
    """Run a command undisturbed and killed, and print the comparison; return the undisturbed."""
    plain, killed = (begin.with_name(f"{attack.title}-{name}") for name in ("plain", "killed"))
    for folder in (plain, killed):
        shutil.copytree(begin, folder, symlinks=True)
    started = time.monotonic()
    subprocess.run(attack.command(plain), check=True, stdout=subprocess.DEVNULL)
    longest = time.monotonic() - started
    one = attack.digests(plain)
    print(f"{attack.title}: undisturbed {longest:.1f} s, {len(one)} files")
    lost = halves = ends = 0
    # A run that goes on with what was kept is over earlier.
    share = 0.35 if attack.title == "run" else 0.9
    for number in range(options.kills if attack.title in options.only else 0):
        before, wait = attack.items(killed), float(rng.uniform(0.15 * share, share) * longest)
        ended = interrupted(attack.command(killed), wait)
        there = attack.digests(killed)
        lost += 0 if ended else len(before - attack.items(killed))
        halves += attack.whole and there not in ({}, one)
        ends += ended
        print(
            f"kill {number + 1:2d} after {wait:5.1f} s: {len(attack.items(killed))} items kept, "
            f"{len(there)} files{' (it had ended)' if ended else ''}"
        )
        if attack.whole and there:
            shutil.rmtree(killed / attack.results[0])
    subprocess.run(attack.command(killed), check=True, stdout=subprocess.DEVNULL)
    two = attack.digests(killed)
    others = differing(one, two)
    left = [path for path in killed.rglob(".*") if ".part" in path.name or ".exported" in path.name]
    print(
        f"{attack.title}: {len(others)} of {len(one)} files differ {others[:3]}; "
        f"{lost} finished items lost; {halves} halves; {len(left)} temporary files left; "
        f"{ends} runs had ended before the kill"
    )
    return plain


def interrupted(command: Sequence[str], seconds: float) -> bool:
    """Run a command and kill it after some seconds; return whether it had ended."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return False
    return True


def run(*arguments: object) -> None:
    """Run a command to its end."""
    subprocess.run(
        [*SPCOLA, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip


if __name__ == "__main__":
    main()
