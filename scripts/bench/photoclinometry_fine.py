"""Photoclinometry at the pixel of the best images, with lidar that does not cover the cells.

Where most of the finest images of `mini` show the same ground, maplets of a finer GSD are tiled
from the shape. They are solved from images alone, with mapolas, and with the single returns, and
compared with the truth next to the shape, to registered mapolas of that GSD, and to fused maplets:
those of the lidar and the shape's slopes. All maplets that images alone solve count, without their
edges.

    python scripts/bench/photoclinometry_fine.py [--gsd 0.15] [--places 4] [--radius 10] [--seed 1]
        [--work DIR]
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from photoclinometry import prepared
from truth import timed

from fusion.scene import Scene
from fusion.stages.register import ImageScene
from fusion.truth.presets import MissionSettings
from fusion.workspace import Workspace
from fusion.workspace.settings.processing import RegisterSettings
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.imagematching import ChoiceOptions
from spcola.truth.body import TruthBody
from spcola.truth.solution import heights_in_frame

# Points at the edges of maplets that are not compared: their slopes are one-sided.
EDGE = 4
FINE, LETTERS = "fine", ("AA", "BB", "CC", "DD", "EE", "FF")
# Sine of the Sun's elevation above which an image determines slopes.
HIGH_SUN = float(np.sin(np.radians(20.0)))
SOLUTIONS = {
    "images alone": ("images", ("shape",)),
    "images, mapolas": ("mapolas", ("shape", "lidar")),
    "images, returns": ("returns", ("shape", "returns")),
}


def best_places(workspace: Path, gsd: float, count: int) -> Iterator[tuple[float, float]]:
    """Yield latitude and longitude (degrees) of maplets that most fine, well lit images show."""
    space = Workspace.open(workspace)
    grids = [space.maplet(name).grid for name in space.maplet_names()]
    scene = ImageScene.of(space, grids, RegisterSettings())
    scene = replace(scene, choice=ChoiceOptions(most=1000))

    def fine(grid: MapletGrid) -> int:
        return sum(
            image.pixel_angle * float(np.linalg.norm(image.position - grid.center)) < 1.3 * gsd
            and image.sun @ grid.uz > HIGH_SUN
            for image in scene.showing(grid)
        )

    for grid in sorted(grids, key=fine, reverse=True)[:count]:
        x, y, z = grid.center
        latitude, longitude = np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)
        yield float(np.degrees(latitude)), float(np.degrees(longitude))


def solved(work: Path, seed: int, gsd: float, radius: float, places: int) -> tuple[Path, list[str]]:
    """Tile, register and solve; return the workspace and its fine maplets."""
    source = prepared(work, "mini", seed, 1.0)
    root = source.with_name("fine")
    shutil.rmtree(root, ignore_errors=True)
    timed(["init", root, "--spc", source.with_name("mission") / "spc", "--body", "Truth"])
    timed(["import", root, *sorted((source.with_name("mission") / "lidar").iterdir())])
    before = set(Workspace.open(root).maplet_names())
    for number, (latitude, longitude) in enumerate(best_places(source, gsd, places)):
        within = f"{latitude:.3f},{longitude:.3f},{radius:g}"
        timed(["spc", "tile", root, "--gsd", gsd, "--within", within, "--from", "shape",
               "--letters", LETTERS[number], "--as", f"{FINE}{number}"])  # fmt: skip
        timed(["solution", "use", root, f"{FINE}{number}"])
    for stage in ("mapolas", "register", "fuse"):
        timed([stage, root])
    names = [name for name in Workspace.open(root).maplet_names() if name not in before]
    only = [word for name in names for word in ("--only", name)]
    for name, constraints in SOLUTIONS.values():
        kinds = [word for kind in constraints for word in ("--constraint", kind)]
        timed(["spc", "lithos", root, *only, "--start", "shape", *kinds, "--as", name])
    return root, names


def errors(
    surfaces: Sequence[tuple[Maplet, np.ndarray]],
) -> tuple[float, float, float, float, float]:
    """Return rms of heights (m) and slopes (degrees), pull, shares within 1 and 2 sigmas.

    `surfaces` are maplets, each with its true heights.
    """
    inner = slice(EDGE, -EDGE)
    heights, slopes, pulls = [], [], []
    for surface, truth in surfaces:
        gsd = surface.grid.gsd
        heights.append((surface.height - truth)[inner, inner].ravel())
        wrong = np.array(slopes_of(surface.height, gsd)) - np.array(slopes_of(truth, gsd))
        slopes.append(np.hypot(*wrong)[inner, inner].ravel())
        pulls.append(heights[-1] / surface.sigma[inner, inner].ravel())
    height, slope, pull = (np.concatenate(part) for part in (heights, slopes, pulls))
    pull = pull[np.isfinite(pull)]
    shares = [float(np.mean(np.abs(pull) < k)) if pull.size else float("nan") for k in (1, 2)]
    spread = float(np.std(pull)) if pull.size else float("nan")
    steep = np.degrees(np.arctan(np.sqrt(np.nanmean(slope**2))))
    return float(np.sqrt(np.nanmean(height**2))), float(steep), spread, shares[0], shares[1]


def compared(root: Path, names: list[str], seed: int) -> Iterator[str]:
    """Yield a line for each surface, and what both sources gain over the better one."""
    settings, space = MissionSettings.mini(seed), Workspace.open(root)
    found = Workspace.open(root, "images").read_json("photoclinometry.json")["maplets"]
    names = [name for name in names if found[name]["outcome"] != "too-few-images"]
    yield f"{len(names)} solved by images alone"
    body = TruthBody(settings.body)

    def judged(surfaces: Iterable[Maplet]) -> tuple[float, float, float, float, float]:
        return errors(
            [(one, heights_in_frame(body, one.grid, settings.to_spc)) for one in surfaces]
        )

    scene = Scene.of(space, light="none")
    lidar = {name: scene.lidar(name, space.maplet(name).grid) for name in names}
    rows = {
        "shape": judged(space.maplet(name) for name in names),
        "mapolas": judged(
            Maplet(name, space.maplet(name).grid, found.height, sigma=found.sigma)
            for name, found in lidar.items()
        ),
        "fused maplets": judged(space.fused(name) for name in names),
    }
    for title, (solution, _) in SOLUTIONS.items():
        made = Workspace.open(root, solution)
        outcomes = made.read_json("photoclinometry.json")["outcomes"]
        rows[title] = judged(made.maplet(name) for name in names)
        yield f"  {title}: {json.dumps(outcomes)}"
    yield f"{'':18}{'heights':>9}{'slopes':>8}{'pull':>7}{'1 sigma':>9}{'2 sigma':>9}"
    for title, (height, slope, pull, one, two) in rows.items():
        yield f"{title:18}{height:9.3f}{slope:8.2f}{pull:7.2f}{one:9.2f}{two:9.2f}"
    both, alone, fused = (
        rows[title] for title in ("images, returns", "images alone", "fused maplets")
    )
    for what, k in (("heights", 0), ("slopes", 1)):
        ratio = both[k] / min(alone[k], fused[k])
        yield f"{what} with both over the better of images and lidar: {ratio:.2f} (goal 0.75)"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gsd", type=float, default=0.15)
    parser.add_argument("--places", type=int, default=4, choices=range(1, len(LETTERS) + 1))
    parser.add_argument("--radius", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path)
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        work = given.work or Path(temporary)
        root, names = solved(work, given.seed, given.gsd, given.radius, given.places)
        print(f"{len(names)} maplets of {given.gsd:g} m", flush=True)
        for line in compared(root, names, given.seed):
            print(line, flush=True)


if __name__ == "__main__":
    main()
