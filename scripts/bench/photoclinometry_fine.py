"""Photoclinometry at the pixel of the best images, with lidar that does not cover the cells.

Where most of the finest images of `mini` show the same ground, maplets of a finer GSD are tiled
from the shape. They are solved from images alone, with mapolas, and with the single returns, and
compared with the truth next to the shape, to registered mapolas of that GSD, and to fused maplets:
those of the lidar and the shape's slopes. All maplets that images alone solve count, without their
edges. Resolved is the wavelength below which less than half of the truth's power is left, and
coherent the one below which the coherence is less than a half; two GSDs are the least that a grid
can have.

    python scripts/bench/photoclinometry_fine.py [--gsd 0.15] [--places 4] [--radius 10] [--seed 1]
        [--work DIR]
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from photoclinometry import prepared
from truth import timed

from fusion.scene import Scene
from fusion.stages.register import ImageScene
from fusion.truth.assessment.resolution import Spectra
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


@dataclass(frozen=True)
class Errors:
    """Errors of surfaces: heights and wavelengths in metres, slopes in degrees."""

    heights: float
    slopes: float
    resolved: float
    coherent: float
    pull: float
    within_one: float
    within_two: float

    @classmethod
    def of(cls, surfaces: Sequence[tuple[Maplet, np.ndarray]]) -> Errors:
        """Return those of maplets, each with its true heights."""
        inner = slice(EDGE, -EDGE)
        heights, slopes, pulls = [], [], []
        first, _ = surfaces[0]
        spectra = Spectra(first.grid.size - 2 * EDGE, first.grid.gsd)
        for surface, truth in surfaces:
            gsd = surface.grid.gsd
            heights.append((surface.height - truth)[inner, inner].ravel())
            wrong = np.array(slopes_of(surface.height, gsd)) - np.array(slopes_of(truth, gsd))
            slopes.append(np.hypot(*wrong)[inner, inner].ravel())
            pulls.append(heights[-1] / surface.sigma[inner, inner].ravel())
            spectra.add(surface.height[inner, inner], truth[inner, inner])
        height, slope, pull = (np.concatenate(part) for part in (heights, slopes, pulls))
        pull = pull[np.isfinite(pull)]
        shares = [float(np.mean(np.abs(pull) < k)) if pull.size else float("nan") for k in (1, 2)]
        transfer = spectra.transfer()
        return cls(
            float(np.sqrt(np.nanmean(height**2))),
            float(np.degrees(np.arctan(np.sqrt(np.nanmean(slope**2))))),
            transfer.half_power,
            transfer.half_coherence,
            float(np.std(pull)) if pull.size else float("nan"),
            *shares,
        )


COLUMNS = [field.name for field in fields(Errors)]


def compared(root: Path, names: list[str], seed: int) -> Iterator[str]:
    """Yield a line for each surface, and what both sources gain over the better one."""
    settings, space = MissionSettings.mini(seed), Workspace.open(root)
    found = Workspace.open(root, "images").read_json("photoclinometry.json")["maplets"]
    names = [name for name in names if found[name]["outcome"] != "too-few-images"]
    yield f"{len(names)} solved by images alone"
    body = TruthBody(settings.body)

    def judged(surfaces: Iterable[Maplet]) -> Errors:
        return Errors.of(
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
    yield f"{'':18}" + "".join(f"{name.replace('_', ' '):>11}" for name in COLUMNS)
    for title, row in rows.items():
        values = (getattr(row, name) for name in COLUMNS)
        yield f"{title:18}" + "".join(f"{value:11.3f}" for value in values)
    both, alone, fused = (
        rows[title] for title in ("images, returns", "images alone", "fused maplets")
    )
    for what in ("heights", "slopes", "resolved", "coherent"):
        better = np.fmin(getattr(alone, what), getattr(fused, what))
        ratio = getattr(both, what) / better
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
