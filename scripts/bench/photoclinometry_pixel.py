"""Photoclinometry from images alone at ever finer GSDs, down to the pixels of the images.

At the places of a synthetic mission that most images show, maplets of each GSD are tiled from the
shape (`spcola spc tile`), solved (`spcola spc lithos --start shape --constraint shape`), and
compared with the truth, without their edges: those that converged. Resolved and coherent are as in
photoclinometry_fine.py, printed in metres, in cells and in pixels: the median pixel of the images
that show a maplet. They are nan where more than half is left down to two GSDs, the grid's limit.

    python scripts/bench/photoclinometry_pixel.py WORKSPACE --mission DIR --solution NAME
        [--gsd 0.16 0.08 0.05] [--places 8]

NAME is a solution that `spcola spc lithos` made: it shows where the images are. The workspace is
left as it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from photoclinometry_fine import Errors
from truth import timed

from fusion.truth.planted import read_truth
from fusion.workspace import Workspace
from spcola.arrays import FloatArray
from spcola.truth.solution import heights_in_frame

# Maplets of a place lie within so many GSDs of it.
REACH = 44.0
# Two places are farther apart than this, radians.
APART = np.radians(15.0)
SEEDS, SOLVED = "pixel-{}", "pixel-solved"
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def pixels_of(fit: Mapping[str, Any]) -> list[float]:
    """Return the pixels of the images that show a maplet, metres, from photoclinometry.json."""
    return [one["pixel_m"] for one in fit["images"].values() if one["fit"] != "not-seen"]


def places(workspace: Path, solution: str, count: int) -> list[str]:
    """Return latitude and longitude, degrees, of the maplets that most images show."""
    space = Workspace.open(workspace, solution)
    fits = space.read_json("photoclinometry.json")["maplets"]
    solved = [name for name, fit in fits.items() if fit["outcome"] == "converged"]
    solved.sort(key=lambda name: len(pixels_of(fits[name])), reverse=True)
    found = list[FloatArray]()
    for name in solved:
        center = space.maplet(name).grid.center
        up = center / np.linalg.norm(center)
        if len(found) < count and all(up @ other < np.cos(APART) for other in found):
            found.append(up)
    degrees = [np.degrees([np.arcsin(z), np.arctan2(y, x)]) for x, y, z in found]
    return [f"{latitude:.4f},{longitude:.4f}" for latitude, longitude in degrees]


def removed(workspace: Path, count: int) -> None:
    """Remove the solutions of this bench; those that are not there are none."""
    for name in (SOLVED, *(SEEDS.format(number) for number in reversed(range(count)))):
        if (workspace / "solutions" / name).is_dir():
            timed(["solution", "remove", workspace, name])


def solved(workspace: Path, where: Sequence[str], gsd: float) -> list[str]:
    """Tile all places, solve the new maplets, and return those that converged."""
    removed(workspace, len(where))
    before, parent = set(Workspace.open(workspace).maplet_names()), list[str]()
    for number, place in enumerate(where):
        timed(["spc", "tile", workspace, "--gsd", gsd, "--within", f"{place},{REACH * gsd:g}",
               "--from", "shape", "--letters", f"Z{LETTERS[number]}", *parent,
               "--as", SEEDS.format(number)])  # fmt: skip
        parent = ["--solution", SEEDS.format(number)]
    tiled = Workspace.open(workspace, SEEDS.format(len(where) - 1)).maplet_names()
    only = [word for name in tiled if name not in before for word in ("--only", name)]
    timed(["spc", "lithos", workspace, *parent, *only, "--start", "shape", "--constraint", "shape",
           "--as", SOLVED])  # fmt: skip
    fits = Workspace.open(workspace, SOLVED).read_json("photoclinometry.json")["maplets"]
    return [name for name, fit in fits.items() if fit["outcome"] == "converged"]


def line(workspace: Path, mission: Path, names: Sequence[str], gsd: float) -> str:
    """Return what is printed of solved maplets of a GSD."""
    space, planted = Workspace.open(workspace, SOLVED), read_truth(mission)
    fits = space.read_json("photoclinometry.json")["maplets"]
    body, maplets = planted.body(), [space.maplet(name) for name in names]
    found = Errors.of(
        [(one, heights_in_frame(body, one.grid, planted.similarity)) for one in maplets]
    )
    images = [pixels_of(fits[name]) for name in names]
    pixel = float(np.median([np.median(one) for one in images]))
    lengths = "; ".join(
        f"{name} {length:.3f} m, {length / gsd:.1f} cells, {length / pixel:.1f} pixels"
        for name, length in (("resolved", found.resolved), ("coherent", found.coherent))
    )
    return (
        f"GSD {gsd:g} m: {len(names)} of {len(fits)} maplets converged, pixels of {pixel:.3f} m, "
        f"{np.median([len(one) for one in images]):g} images (medians)\n"
        f"  heights {found.heights:.4f} m, slopes {found.slopes:.2f} deg, pull {found.pull:.2f}, "
        f"within one and two sigmas {found.within_one:.2f} {found.within_two:.2f}\n  {lengths}"
    )


def compared(
    workspace: Path, mission: Path, solution: str, gsds: Sequence[float], count: int
) -> Iterator[str]:
    """Yield what is printed, GSD by GSD."""
    where = places(workspace, solution, count)
    yield f"{len(where)} places: {'; '.join(where)}"
    try:
        for gsd in gsds:
            names = solved(workspace, where, gsd)
            if names:
                yield line(workspace, mission, names, gsd)
            else:
                yield f"GSD {gsd:g} m: no maplet converged"
    finally:
        removed(workspace, len(where))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors at each GSD."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--mission", type=Path, required=True)
    parser.add_argument("--solution", required=True)
    parser.add_argument("--gsd", type=float, nargs="+", default=[0.16, 0.08, 0.05])
    parser.add_argument("--places", type=int, default=8, choices=range(1, len(LETTERS) + 1))
    given = parser.parse_args(arguments)
    for text in compared(given.workspace, given.mission, given.solution, given.gsd, given.places):
        print(text, flush=True)


if __name__ == "__main__":
    main()
