"""Photoclinometry on real images: NavCam frames of 67P, Apollo 15, Vesta, and landmarks of 67P.

All of it by the real commands, from the shared data into a folder: images come in, states are
fitted to the shape (`spc register`), maplets are tiled over it and solved (`spc lithos`), without
every tenth frame. For these the brightness that the maplets predict is compared with that of their
start, at the states that they get against the same shape.

    python scripts/bench/photoclinometry_real.py [--data ../shared/data] [--work DIR]
        [--parts 67p apollo15 vesta landmarks] [--workers 1] [--maplets N] [--gammas 1 1.5 2 2.5]
        [--every 1]

`--gammas` imports every fourth frame of 67P with several encodings of the brightness, and prints
which one fits. `--maplets` solves so many maplets of each body only, `--every 4` takes every fourth
frame of 67P, for a trial. All takes a quarter of an hour
on one core.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from real.moon import MOON, agreed_radius, boresight, with_sigmas
from real.predicted import pairs_of
from real.printed import print_albedo, print_map, print_pairs, write_page
from real.summaries import (
    UNSOLVED,
    print_outcomes,
    print_photometry,
    print_slopes_by_sun,
    print_states,
)

from fusion.scene import Exposures
from fusion.workspace import Workspace
from spcola.camera import SpcImage, project_image
from spcola.formats.shapes import write_icq
from spcola.formats.solution import read_landmark, read_summary, write_summary
from spcola.photometry.functions import photometric_function
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions

NAVCAM = """[NAVCAM]
focal_length_mm = 152.5
center = [256.5, 256.5]
k_matrix = [[38.448288, 0.0, 0.0], [0.0, 38.448288, 0.0]]
size = [512, 512]
"""
# What the frames of 67P fit best: see --gammas.
GAMMA = 2
TENTH = 10


@dataclass(frozen=True)
class Run:
    """Where the data are and the work is done.

    Parameters
    ----------
    data, work : Path
    workers : int
    maplets : int
        Most maplets that are solved; 0 for all.
    every : int
        Every n-th frame of 67P is used; 1 for all.
    """

    data: Path
    work: Path
    workers: int
    maplets: int
    every: int

    def spcola(self, *words: object, parallel: bool = True) -> dict[str, Any]:
        """Run a command and return its object."""
        more = ["--workers", str(self.workers)] if parallel else []
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "fusion.cli", *map(str, words), *more, "--json"],
            check=False, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            sys.exit(done.stderr.splitlines()[-1])
        shown = " ".join(str(word) for word in words[:2])
        print(f"  {shown:24s}{time.perf_counter() - start:7.1f} s", flush=True)
        content: dict[str, Any] = json.loads(done.stdout)
        return content

    def solved(self, root: Path, *words: object) -> tuple[dict[str, Any], Workspace, Workspace]:
        """Solve the maplets in use; return what was found, and the workspace before and after."""
        start = Workspace.open(root)
        names = [name for name in start.maplet_names() if start.landmark(name).pictures]
        step = max(1, len(names) // self.maplets) if self.maplets else 1
        only = [word for name in names[::step] for word in ("--only", name)]
        found = self.spcola("spc", "lithos", root, *words, *only, "--as", "images")
        print_outcomes(found)
        return found, start, Workspace.open(root, "images")


def comet(run: Run) -> None:
    """67P: 63 frames, and 7 that are left out."""
    print("67P, NavCam")
    folder = run.data / "rosetta_67p" / "navcam"
    frames = sorted(folder.glob("images/*.png"))[:: run.every]
    kept = [path for k, path in enumerate(frames) if k % TENTH]
    roots = [
        _comet_workspace(run, run.work / name, some, GAMMA)
        for name, some in (("67p", kept), ("67p-left-out", frames[::TENTH]))
    ]
    for root in roots:
        print_states(run.spcola("spc", "register", root, "--as", "registered"))
        run.spcola("solution", "use", root, "registered", parallel=False)
    root = roots[0]
    tiled = run.spcola(
        "spc", "tile", root, "--gsd", 18, "--half-size", 24, "--from", "shape", "--as", "tiles"
    )
    print(f"  {tiled['maplets']} maplets, {tiled['without_pictures']} without images")
    run.spcola("solution", "use", root, "tiles", parallel=False)
    setting = print_photometry(run.spcola("photometry", "fit", root))
    content, start, images = run.solved(root, "--photometry", setting)
    held = _exposed(Workspace.open(roots[1]))
    _print_left_out(run, "67P", setting, content, (start, images), held)


def _comet_workspace(run: Run, root: Path, frames: Sequence[Path], gamma: float) -> Path:
    folder = run.data / "rosetta_67p" / "navcam"
    camera = run.work / "navcam.toml"
    camera.write_text(NAVCAM, encoding="utf-8")
    run.spcola("init", root, "--body", "67P", "--shape", folder / "67p-4k.obj", parallel=False)
    run.spcola(
        "images", root, *frames, "--poses", folder / "poses.csv", "--camera", camera,
        "--letter", "N", "--gamma", gamma,
    )  # fmt: skip
    return root


def encodings(run: Run, gammas: Sequence[float]) -> None:
    """Print which encoding of the brightness fits the frames of 67P."""
    print("67P, encoding of the brightness: residual of the best function, over gamma")
    frames = sorted((run.data / "rosetta_67p" / "navcam").glob("images/*.png"))[::4]
    for gamma in gammas:
        root = _comet_workspace(run, run.work / f"gamma-{gamma:g}", frames, gamma)
        run.spcola("spc", "register", root, "--as", "registered")
        run.spcola("solution", "use", root, "registered", parallel=False)
        run.spcola(
            "spc", "tile", root, "--gsd", 18, "--half-size", 24, "--from", "shape", "--as", "tiles"
        )
        run.spcola("solution", "use", root, "tiles", parallel=False)
        functions = ("--function", "akimov", "--function", "minnaert")
        (found,) = run.spcola("photometry", "fit", root, *functions)["filters"]
        best = min(one["residual_std"] for one in found["functions"])
        print(f"  gamma {gamma:3.1f}: {best:.2%} / gamma = {best / gamma:.2%}")


def vesta(run: Run) -> None:
    """Vesta: three frames, and one that is left out."""
    print("Vesta, Dawn FC2")
    folder = run.data / "vesta"
    frames = sorted(folder.glob("images/*.png"))
    held = frames[1]
    roots = []
    for name, some in (("vesta", [f for f in frames if f != held]), ("vesta-left-out", [held])):
        root = run.work / name
        shape = folder / "vesta_5002.ply"
        run.spcola("init", root, "--body", "Vesta", "--shape", shape, parallel=False)
        run.spcola(
            "images", root, *some, "--states", "colmap", "--model", folder, "--times",
            folder / "frames.csv",
        )  # fmt: skip
        print_states(run.spcola("spc", "register", root, "--as", "registered"))
        run.spcola("solution", "use", root, "registered", parallel=False)
        roots.append(root)
    first = Workspace.open(roots[0])
    caster = RayCaster(first.shape())
    latitude, longitude = _lit_place(first.images(), caster)
    _tile(run, roots[0], f"{latitude:.2f},{longitude:.2f},70000", 380)
    content, start, images = run.solved(roots[0])
    function = content["options"]["photometry"]
    left_out = _exposed(Workspace.open(roots[1]))
    _print_left_out(run, "Vesta", function, content, (start, images), left_out)


def moon(run: Run) -> None:
    """Apollo 15: two crops, and one that is left out; one Sun."""
    print("Apollo 15, Metric Camera")
    cubes = sorted((run.data / "apollo15").glob("*.cub"))
    # Their stereo lies above the sphere: maplets begin where the frames agree.
    ball = run.work / "moon.txt"
    write_icq(ball, IcqShape(MOON * icq_directions(48)), digits=9)
    trial = run.work / "moon-trial"
    run.spcola("init", trial, "--body", "Moon", "--shape", ball, parallel=False)
    run.spcola("images", trial, *cubes, "--states", "label")
    images = _exposed(Workspace.open(trial))
    radius = agreed_radius(images)
    print(f"  the crops agree best on a sphere {radius - MOON:+.0f} m above {MOON:.0f} m")
    shape = run.work / "moon-agreed.txt"
    write_icq(shape, IcqShape(radius * icq_directions(48)), digits=9)
    root = run.work / "moon"
    run.spcola("init", root, "--body", "Moon", "--shape", shape, parallel=False)
    run.spcola("images", root, cubes[0], cubes[2], "--states", "label")
    workspace = Workspace.open(root)
    for image in workspace.images():
        path = workspace.image_path(image.name)
        stated = with_sigmas(read_summary(path))
        path.unlink()
        write_summary(path, stated)
    caster = RayCaster(workspace.shape())
    middle = caster.cast(*boresight(images[1])).points[0]
    latitude, longitude = _degrees(middle)
    _tile(run, root, f"{latitude:.4f},{longitude:.4f},18000", 130)
    content, start, after = run.solved(root, "--shape-sigma", 1000)
    print_slopes_by_sun(after, content)
    function = content["options"]["photometry"]
    _print_left_out(run, "Moon", function, content, (start, after), images[1:2])


def landmarks(run: Run) -> None:
    """The .SUM and .LMK files of 67P: reprojection, and the shape of the NavCam frames there."""
    print("67P, landmarks of an SPC solution")
    folder = run.data / "rosetta_67p"
    image = read_summary(next(folder.glob("*.SUM")))
    places = {one.name: (one.pixel, one.line) for one in image.landmarks}
    workspace = run.work / "landmarks"
    shape = folder / "navcam" / "67p-4k.obj"
    run.spcola("init", workspace, "--body", "67P", "--shape", shape, parallel=False)
    caster = RayCaster(Workspace.open(workspace).shape())
    for path in sorted(folder.glob("*.LMK")):
        grid = read_landmark(path).grid
        off = np.array(places[path.stem]) - np.array(project_image(image, grid.center))
        hit = caster.cast(grid.center + 500.0 * grid.uz, -grid.uz[None])
        above = 500.0 - float(hit.distance[0]) if hit.hit[0] else float("nan")
        print(
            f"  {path.stem}: observed less predicted {off[0]:+.2f}, {off[1]:+.2f} px; the shape "
            f"lies {above:+.0f} m above it, {grid.center.round(0)}"
        )


def _tile(run: Run, root: Path, within: str, gsd: float) -> None:
    tiled = run.spcola(
        "spc", "tile", root, "--gsd", gsd, "--half-size", 24, "--within", within, "--from", "shape",
        "--as", "tiles",
    )  # fmt: skip
    print(f"  {tiled['maplets']} maplets, {tiled['without_pictures']} without images")
    run.spcola("solution", "use", root, "tiles", parallel=False)


def _exposed(workspace: Workspace) -> list[SpcImage]:
    exposed = Exposures(workspace)
    return [exposed(image) for image in workspace.images()]


def _print_left_out(
    run: Run,
    title: str,
    setting: str,
    content: dict[str, Any],
    solutions: tuple[Workspace, Workspace],
    held: list[SpcImage],
) -> None:
    """Print what the maplets predict for frames that were left out, and the albedo."""
    names = [n for n, one in content["maplets"].items() if one["outcome"] not in UNSOLVED]
    start, solved = ({n: some.maplet(n) for n in names} for some in solutions)
    if not names:
        return
    moved = [float(np.nanstd(solved[n].height - start[n].height)) for n in names]
    print(f"  heights changed by {np.median(moved):.1f} m rms (median over maplets)")
    caster = RayCaster(solutions[0].shape())
    begun = time.process_time()
    function = photometric_function(setting)
    pairs = list(pairs_of(held, start, solved, caster, function))
    print(f"  compared in {time.process_time() - begun:.0f} s")
    if not pairs:
        print("  no left-out frame shows a solved maplet well")
        return
    print_pairs(pairs)
    print_map(pairs)
    print_albedo(solved)
    write_page(run.work / f"{title.lower()}.html", f"{title}: left-out frames", pairs)


def _lit_place(images: Sequence[SpcImage], caster: RayCaster) -> tuple[float, float]:
    """Return where the ground is that all images see in good light, degrees."""
    toward = sum(image.position / np.linalg.norm(image.position) + image.sun for image in images)
    toward = toward / np.linalg.norm(toward)
    hit = caster.cast(3.0 * caster.radius * toward, -toward[None])
    return _degrees(hit.points[0])


def _degrees(point: np.ndarray) -> tuple[float, float]:
    x, y, z = point
    latitude = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return float(latitude), float(np.degrees(np.arctan2(y, x)) % 360.0)


PARTS = {"67p": comet, "apollo15": moon, "vesta": vesta, "landmarks": landmarks}


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--work", type=Path)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--maplets", type=int, default=0)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--gammas", nargs="+", type=float, default=[])
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        work = asked.work or Path(made)
        work.mkdir(parents=True, exist_ok=True)
        run = Run(asked.data.resolve(), work, asked.workers, asked.maplets, asked.every)
        if asked.gammas:
            encodings(run, asked.gammas)
        for part in asked.parts:
            PARTS[part](run)


if __name__ == "__main__":
    main()
