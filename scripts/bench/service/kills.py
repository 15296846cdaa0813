"""Kills the server and its worker while jobs of every kind that writes run, and compares the end.

    python -m scripts.bench.service.kills [--kills 3] [--preset tiny] [--seed 3] [--work DIR]
        [--only import fuse ...]

A folder of the service with all uploads is served twice, at the same place. First all jobs run
undisturbed. Then each job runs several times from the same workspace: in every round the server and
its worker are killed (-9) once each at random moments of the job, the server is started again, and
at the job's end all files of the workspace and all outputs are compared with the undisturbed ones.
Not compared: the index `catalog.sqlite` and locks, and in the notes of runs and solutions when, how
long and by which job.
`kills` are those that met the job at work; `redone` counts finished items that were lost or made
again; `left` are files that no undisturbed run leaves, in the workspace or of the service.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import numpy as np

BENCH = Path(__file__).parents[1]
sys.path[:0] = [str(BENCH), str(BENCH.parents[1] / "tests" / "helpers")]
from images import make_different  # noqa: E402
from kills import differing, run  # noqa: E402
from star_cruise import Cruise  # noqa: E402

from fusion.workspace import SETTINGS_FILE, Workspace  # noqa: E402
from fusion.workspace.settings import Settings, write_settings  # noqa: E402
from scripts.bench.service.served import (  # noqa: E402
    Served,
    Step,
    awaited,
    job_of,
    submit,
    upload,
)

STAGES = ("mapolas", "register", "fuse", "bigmap", "scale", "release", "report")
# Without hidden files: one that is being written when the kill comes is no finished item.
KEPT = (
    ".items/*/[!.]*.npz",
    "scans/[!.]*.h5",
    *(f"{folder}/[!.]*" for folder in ("MAPFILES", "IMAGEFILES", "SUMFILES")),
)
ACCEPTED = ["epsilon-not-significant", "epsilon-not-separable"]
PICTURES, SIZE = 60, 128
ROUNDS = 4


@dataclass
class Found:
    """What a step's kills did."""

    server: int = 0
    worker: int = 0
    files: int = 0
    differing: set[str] = field(default_factory=set)
    redone: set[str] = field(default_factory=set)
    left: set[str] = field(default_factory=set)
    failed: list[str] = field(default_factory=list)

    def line(self, title: str) -> str:
        """Return the line of the table."""
        sets = (self.differing, self.redone, self.left)
        columns = "".join(f"{len(one):8d}" for one in sets)
        shown = [*self.failed, *(one for found in sets for one in sorted(found)[:2])]
        more = f"  {'; '.join(shown)}" if shown else ""
        return f"{title:17}{self.server:8d}{self.worker:8d}{self.files:8d}{columns}{more}"

    @property
    def bad(self) -> bool:
        return bool(self.differing or self.redone or self.left or self.failed)


@dataclass(frozen=True)
class After:
    """What an undisturbed step left, and how long it took."""

    seconds: float
    files: dict[str, str]
    aside: set[str]


def steps_of(work: Path, options: argparse.Namespace) -> list[Step]:
    """Make the files, and return every job that writes."""
    mission, pictures, stars = (work / name for name in ("mission", "pictures", "stars"))
    run("truth", "make", mission, "--preset", options.preset, "--seed", options.seed)
    for folder in (pictures, stars):
        folder.mkdir()
    paths, poses, camera = make_different(pictures, PICTURES, SIZE)
    pixels = [path.with_suffix(".img") for path in paths if path.suffix == ".lbl"]
    cruise = Cruise(stars)
    calibration: dict[str, Path | list[Path]] = {
        "camera": stars / "nominal.toml",
        "catalogue": stars / "sky.csv",
        "attitudes": cruise.attitudes(),
        "stars": cruise.positions(),
    }
    spc = [path for path in sorted((mission / "spc").rglob("*")) if path.is_file()]
    shape = next((mission / "spc" / "SHAPEFILES").iterdir())
    spc.remove(shape)
    lidar = sorted((mission / "lidar").iterdir())
    table: dict[str, Path | list[Path]] = {"poses": poses, "camera": camera}
    return [
        Step("init", "tiny", "init", {"body": "Truth"}, {"uploads": spc, "shape": shape}),
        Step("import", "tiny", "import", {}, {"uploads": lidar}),
        *(Step(stage, "tiny", "run", {"stages": [stage]}) for stage in STAGES),
        Step("scale-apply", "tiny", "scale-apply", {"name": "scaled", "accept": ACCEPTED}),
        Step("solution-export", "tiny", "solution-export", {"name": "scaled", "folder": "spc"}),
        Step(
            "truth-assess", "tiny", "truth-assess", {"report": "truth.html", "patches": 50},
            {"truth": mission / "truth.json"},
        ),
        Step("solution-use", "tiny", "solution-use", {"name": "imported"}),
        Step("solution-remove", "tiny", "solution-remove", {"name": "scaled"}),
        Step("images", "states", "images", {}, {"uploads": [*paths, *pixels], **table}),
        Step(
            "sumfiles", "nothing", "sumfiles", {"sigma_m": 2.0},
            {"poses": later(poses), "camera": camera},
        ),
        Step("kernels", "nothing", "kernels", {"out": "kernels"}),
        Step(
            "camera-convert", "states", "camera-convert", {"out": "cam.toml", "name": "B"},
            {"uploads": [camera]},
        ),
        Step("camera-calibrate", "states", "camera-calibrate", {"out": "nac.toml"}, calibration),
    ]  # fmt: skip


def later(poses: Path) -> Path:
    """Write a table of poses in which each image has a time of its own."""
    head, *rows = poses.read_text().splitlines()
    parts = [row.split(",") for row in rows]
    for number, part in enumerate(parts):
        part[1] = f"2019-03-03T{8 + number // 60:02d}:{number % 60:02d}:59.923"
    path = poses.with_name("later.csv")
    path.write_text("\n".join([head, *(",".join(part) for part in parts)]) + "\n")
    return path


def turning(root: Path) -> None:
    """Make a workspace without maplets whose body turns."""
    pole = {"pole_ra_deg": 85.45, "pole_dec_deg": -60.37, "meridian_deg": 140.69}
    settings = Settings().with_table("spin", **pole, rate_deg_per_day=2011.15)
    settings = settings.with_table("spice", spacecraft="-64", body=2101955)
    Workspace.create(root, settings.with_table("body", name="Ball"))
    write_settings(root / SETTINGS_FILE, settings.with_table("body", name="Ball"))


def uploaded(client: httpx.Client, step: Step) -> dict[str, Any]:
    """Upload the files of a step; return the parameters that name them."""
    return {
        name: [upload(client, step.workspace, one) for one in given]
        if isinstance(given, list)
        else upload(client, step.workspace, given)
        for name, given in step.files.items()
    }


class Bench:
    """The served folder, and what the undisturbed steps left in it."""

    def __init__(self, work: Path, options: argparse.Namespace) -> None:
        self.options, self.rng = options, np.random.default_rng(options.seed)
        self.served, self.work, self.kept = Served(work / "served"), work, work / "kept"

    def prepare(self) -> None:
        """Upload all files, keep the folder, and do all steps undisturbed."""
        work = self.work
        steps, only = steps_of(work, self.options), self.options.only
        titles = [step.title for step in steps]
        if unknown := [title for title in only if title not in titles]:
            raise SystemExit(f"there is no job {', '.join(unknown)}; there are {', '.join(titles)}")
        # What a chosen job finds is what the jobs before it in its workspace left.
        chosen = {step.workspace for step in steps if step.title in only}
        self.steps = [step for step in steps if not only or step.workspace in chosen]
        for name in ("states", "nothing"):
            turning(self.served.folder / name)
        with self.served.start() as client:
            self.given = {step.title: uploaded(client, step) for step in self.steps}
        self.served.stop()
        begin = work / "begin"
        shutil.copytree(self.served.folder, begin, symlinks=True)
        with self.served.start() as client:
            self.after = {step.title: self._undisturbed(client, step) for step in self.steps}
        self.served.stop()
        self.served.folder.rename(work / "undisturbed")
        begin.rename(self.served.folder)

    def run(self) -> bool:
        """Do all steps with kills; return whether one went wrong."""
        heads = ("server", "worker", "files", "differ", "redone", "left")
        print(f"{'stage':17}" + "".join(f"{head:>8}" for head in heads))
        bad, self.client = False, self.served.start()
        for step in self.steps:
            if self.options.only and step.title not in self.options.only:
                self._undisturbed(self.client, step)
                continue
            found = self._attacked(step)
            bad |= found.bad
            print(found.line(step.title), flush=True)
        return bad

    def _undisturbed(self, client: httpx.Client, step: Step) -> After:
        """Do a step without kills."""
        done = awaited(client, submit(client, step, self.given[step.title]), ())
        if done["state"] != "finished":
            raise SystemExit(f"{step.title}: {done['error']}")
        seconds = float(done["ended"] - done["begun"])
        return After(seconds, self.served.files(step.workspace), self.served.aside())

    def _attacked(self, step: Step) -> Found:
        """Do a step in several rounds with kills."""
        found = Found()
        self.served.keep(step.workspace, self.kept)
        for number in range(ROUNDS * self.options.kills):
            if number:
                self.served.restore(step.workspace, self.kept)
            order = ("server", "worker") if number % 2 == 0 else ("worker", "server")
            self._round(step, order, found)
            if min(found.server, found.worker) >= self.options.kills or found.failed:
                break
        return found

    def _round(self, step: Step, order: tuple[str, str], found: Found) -> None:
        """Do a step once, with a kill of each kind."""
        items: dict[str, int] = {}
        job, tries = submit(self.client, step, self.given[step.title]), 1
        longest = self.after[step.title].seconds
        for which in order:
            awaited(self.client, job, ("running",), tries)
            time.sleep(float(self.rng.uniform(0.0, longest if tries == 1 else 0.6 * longest)))
            # As it is now: when the server is back, the job may have ended already.
            now = job_of(self.client, job)
            self._kill(which)
            items |= self._items(step.workspace)
            if now["state"] in ("waiting", "running"):
                setattr(found, which, getattr(found, which) + 1)
                tries += 1
        done = awaited(self.client, job, ())
        if done["state"] != "finished":
            found.failed.append(f"{done['error']['code']}: {done['error']['text'][:150]}")
            return
        self._compare(step, items, found)

    def _kill(self, which: str) -> None:
        """Kill the server, and start another; or its worker."""
        if which == "worker":
            assert self.served.server is not None
            self.served.server.kill_worker()
            return
        self.client.close()
        self.served.kill()
        self.client = self.served.start()

    def _items(self, workspace: str) -> dict[str, int]:
        """Return the finished items: the number of each file on the disk."""
        root = self.served.folder / workspace
        files = (path for pattern in KEPT for path in root.glob(pattern))
        return {str(path.relative_to(root)): os.lstat(path).st_ino for path in files}

    def _compare(self, step: Step, items: dict[str, int], found: Found) -> None:
        after, now = self.after[step.title], self.served.files(step.workspace)
        new = now.keys() - after.files.keys()
        found.files = len(after.files)
        found.left |= {*new, *(self.served.aside() - after.aside)}
        found.differing |= set(differing(after.files, now)) - new
        there = self._items(step.workspace)
        found.redone |= {name for name, number in items.items() if there.get(name) != number}


def main() -> int:
    """Do all steps and print the table; return 1 if a result differs or something is left."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=3, help="of the server, and of the worker")
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="the jobs that are killed")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(options.work or Path(folder), options)
        try:
            bench.prepare()
            return int(bench.run())
        finally:
            bench.served.kill()


if __name__ == "__main__":
    sys.exit(main())
