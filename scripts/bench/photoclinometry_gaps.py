"""Photoclinometry where the lidar has gaps: stripes around the body without returns.

The returns of `mini` in stripes across the axis are removed, a third of the ground. SPC maplets,
mapolas, fused maplets, and solutions from images alone and with the returns are compared with the
truth, in the gaps and outside of them. A false return counts where it is, not where its shot hit:
some stay in the gaps.

    python scripts/bench/photoclinometry_gaps.py [--width 10] [--seed 1] [--work DIR]
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from photoclinometry import ALONE, RETURNS, findings, prepared
from photoclinometry_fine import Errors
from truth import timed

from fusion.scene import Scene
from fusion.truth.presets import MissionSettings
from fusion.workspace import Workspace
from lidar.formats import open_lidar
from lidar.truth import write_scans
from spcola.grids import Maplet
from spcola.truth.body import TruthBody
from spcola.truth.solution import heights_in_frame

# One stripe in three has no returns.
PERIOD = 3
IMAGES = ("spc", "lithos", "--start", "shape", *ALONE, "--as", "images")
WITH_RETURNS = ("spc", "lithos", "--start", "shape", *RETURNS, "--as", "returns")


def in_gap(places: np.ndarray, width: float) -> np.ndarray:
    """Return which places (..., 3), body-fixed, metres, lie in a stripe without returns."""
    gap: np.ndarray = np.floor(places[..., 2] / width) % PERIOD == 0
    return gap


def with_gaps(source: Path, folder: Path, width: float) -> list[Path]:
    """Write the scans of a mission without their returns in the stripes; return the files."""
    folder.mkdir(parents=True)
    files = []
    for path in sorted(source.iterdir()):
        files.append(folder / path.name)
        scans = (scan.select(~in_gap(scan.points, width)) for scan in open_lidar(path))
        write_scans(files[-1], scans, format="ola")
    return files


def solved(work: Path, seed: int, width: float) -> Path:
    """Return a workspace with the solutions, of a lidar with gaps."""
    mission = prepared(work, "mini", seed, 1.0).with_name("mission")
    folder = work / f"gaps{seed}-{width:g}"
    root = folder / "workspace"
    shutil.rmtree(folder, ignore_errors=True)
    files = with_gaps(mission / "lidar", folder / "lidar", width)
    timed(["init", root, "--spc", mission / "spc", "--body", "Truth"])
    timed(["import", root, *files])
    for stage in ("mapolas", "register"):
        timed([stage, root])
    accept = findings(root, "registration.json")
    timed(["fuse", root, *accept])
    for (*command, name), extra in ((IMAGES, []), (WITH_RETURNS, accept)):
        timed([*command[:2], root, *command[2:], name, *extra])
    return root


def compared(root: Path, seed: int, width: float) -> Iterator[str]:
    """Yield a line for each surface, in gaps and outside."""
    settings, space = MissionSettings.mini(seed), Workspace.open(root)
    body, back = TruthBody(settings.body), settings.to_spc.inverse()
    names = space.maplet_names()

    def truth(maplet: Maplet) -> tuple[np.ndarray, np.ndarray]:
        """Heights on the grid of a maplet (fused ones have moved), and which lie in a gap."""
        height = heights_in_frame(body, maplet.grid, settings.to_spc)
        return height, in_gap(back.apply(maplet.grid.points(height)), width)

    scene = Scene.of(space, light="none")

    def mapola(name: str) -> Maplet:
        grid = space.maplet(name).grid
        found = scene.lidar(name, grid)
        return Maplet(name, grid, found.height, sigma=found.sigma)

    surfaces: dict[str, Callable[[str], Maplet]] = {
        "SPC maplets": space.maplet,
        "mapolas": mapola,
        "fused maplets": space.fused,
        "images alone": Workspace.open(root, "images").maplet,
        "images, returns": Workspace.open(root, "returns").maplet,
    }
    lines, share = [], 0.0
    for title, surface in surfaces.items():
        maplets = [surface(name) for name in names]
        truths, gaps = zip(*(truth(maplet) for maplet in maplets), strict=True)
        share = float(np.mean(gaps))
        for where, outside in (("in gaps", False), ("outside", True)):
            chosen = [
                np.where(gap ^ outside, height, np.nan)
                for height, gap in zip(truths, gaps, strict=True)
            ]
            found = Errors.of(list(zip(maplets, chosen, strict=True)))
            shares = f"{found.within_one:9.2f}{found.within_two:9.2f}"
            numbers = f"{found.heights:9.3f}{found.slopes:8.2f}{found.pull:7.2f}{shares}"
            lines.append(f"{title:18}{numbers}  {where}")
    yield f"stripes of {width:g} m without returns: {share:.0%} of the ground"
    yield f"{'':18}{'heights':>9}{'slopes':>8}{'pull':>7}{'1 sigma':>9}{'2 sigma':>9}"
    yield from lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        root = solved(given.work or Path(temporary), given.seed, given.width)
        for line in compared(root, given.seed, given.width):
            print(line, flush=True)


if __name__ == "__main__":
    main()
