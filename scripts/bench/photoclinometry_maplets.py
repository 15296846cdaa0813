"""Maplets from images against the truth, each in pixels of the best images that show it.

Of a solution that `spcola spc lithos` made of a synthetic mission, printed next to the maplets
of the solution in use.

- heights: each maplet's root mean square of the errors about their mean, in metres and in pixels of
  the best image.
- slopes: errors of the slopes at points, at the GSD of the maplets, against those of the ground and
  of its means over a cell, which pixels see; errors of the steps between neighbouring means over a
  pixel of the images (the median of those that show the maplet, whole cells), over its side; shares
  of the errors of both slopes of cells within one and two of their sigmas, over all maplets.
- albedo: correlation of the relative albedo of each maplet with the truth where three of its images
  or more show the ground with an incidence below 60 degrees: at points, against means of the truth
  over the square of a cell about them, of means over 3 x 3 points, and of means over a pixel (as
  for slopes); and its multiple correlation with both slopes, next to that of the true albedo with
  the true slopes.

Then slopes and albedo of maplets by the number of their images.

    python scripts/bench/photoclinometry_maplets.py WORKSPACE --mission DIR --solution NAME
        [--every 1] [--limit]

Only every so many converged maplets are compared. `--limit` solves them again with the true heights
as a map that constrains them (`spcola spc lithos --map`), in a solution of its own: what noise, and
ground that cells do not resolve, leave of the albedo.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from maplets.albedo import AlbedoErrors, TrueGround, albedo_errors, albedo_lines
from maplets.means import EDGE, mean_heights, over_pixels, pixel_side
from truth import timed

from fusion.truth.planted import Planted, read_truth
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.formats.image_sigmas import (
    albedo_sigma_path,
    read_albedo_sigma,
    read_slope_sigma,
    slope_sigma_path,
)
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet
from spcola.heights.slopes import slopes_of
from spcola.photometry.ground import Ground
from spcola.photometry.photoclinometry.surface import cell_slopes
from spcola.truth.body import TruthBody
from spcola.truth.solution import heights_in_frame

# Goals of the issue: typical and largest height error (pixels), slopes (degrees).
TYPICAL_PX, MOST_PX, SLOPES_DEG = 1.0, 3.0, 3.0
# Incidence of the goal for albedo, and images that have to show the ground like that.
MOST_INCIDENCE, LEAST_IMAGES = np.radians(60.0), 3
# Groups of maplets by the number of their images begin with these.
GROUPS = (2, 5, 7, 9, 1000)
# Solution of maplets on their true heights, and the sigma of these, GSDs.
LIMIT, TRUE_SIGMA = "on-true-heights", 0.001


@dataclass(frozen=True)
class Errors:
    """Of one maplet.

    Parameters
    ----------
    images : int
        That show it.
    pixel, usual_pixel : float
        Of the best of them, and their median, metres.
    height, slope : float
        Root mean square: heights about their mean, metres; slopes at points, degrees.
    seen_slope : float
        The latter against the slopes of the ground's means over a cell.
    pixel_slope : float
        Of slopes between means over the median pixel.
    tilts : ndarray
        Errors of the slopes of cells, over their sigmas.
    albedo : AlbedoErrors, optional
        None where too little ground is lit well.
    """

    images: int
    pixel: float
    usual_pixel: float
    height: float
    slope: float
    seen_slope: float
    pixel_slope: float
    tilts: np.ndarray
    albedo: AlbedoErrors | None


@dataclass(frozen=True, eq=False)
class Made:
    """A maplet of a solution, with the sigmas of its albedo and slopes; NaN if there are none."""

    maplet: Maplet
    albedo_sigma: np.ndarray
    slope_sigma: np.ndarray

    @classmethod
    def of(cls, space: Workspace, name: str) -> Self:
        """Read a maplet and its companions."""
        maplet, path = space.maplet(name), space.maplet_path(name)
        half, cells = maplet.grid.half_size, maplet.grid.size - 1
        albedo, slopes = np.full(maplet.grid.shape, np.nan), np.full((2, cells, cells), np.nan)
        if (companion := albedo_sigma_path(path)).exists():
            albedo = read_albedo_sigma(companion, half)
        if (companion := slope_sigma_path(path)).exists():
            slopes = read_slope_sigma(companion, half)
        return cls(maplet, albedo, slopes)


@dataclass(frozen=True, eq=False)
class Truth:
    """Heights and albedo of the planted body on grids of the solution, and which images show them.

    Parameters
    ----------
    planted : Planted
    images : mapping of str to SpcImage
    fits : mapping of str to mapping
        Of each maplet in ``photoclinometry.json``.
    """

    planted: Planted
    images: Mapping[str, SpcImage]
    fits: Mapping[str, Mapping[str, Any]]

    @cached_property
    def body(self) -> TruthBody:
        """The planted body."""
        return self.planted.body()

    def errors(self, made: Made, name: str) -> Errors:
        """Compare a maplet of a solution and its sigmas with the truth."""
        maplet = made.maplet
        fits = self.fits[name]["images"].items()
        seen = {image: fit for image, fit in fits if fit["fit"] != "not-seen"}
        pixels = [fit["pixel_m"] for fit in seen.values()]
        usual = float(np.median(pixels))
        inner = slice(EDGE, -EDGE)
        height = heights_in_frame(self.body, maplet.grid, self.planted.similarity)
        wrong = (maplet.height - height)[inner, inner]
        gsd = maplet.grid.gsd
        seen_height = mean_heights(self.body, maplet.grid, self.planted.similarity)
        slope, seen_slope = (
            steepness(maplet.height - truth, gsd) for truth in (height, seen_height)
        )
        tilts = cell_slopes(maplet.height - height, gsd) / made.slope_sigma
        tilts = tilts[:, inner, inner]
        ground = TrueGround.of(self.body, maplet.grid, height, self.planted.similarity)
        well = self.well_lit(Ground.of(maplet.grid, height), seen)
        albedo = albedo_errors(maplet, made.albedo_sigma, ground, well, usual)
        return Errors(
            len(seen),
            min(pixels),
            usual,
            float(np.nanstd(wrong)),
            slope,
            seen_slope,
            between_pixels(maplet.height - seen_height, gsd, usual),
            tilts[np.isfinite(tilts)],
            albedo,
        )

    def well_lit(self, ground: Ground, seen: Iterable[str]) -> np.ndarray:
        """Return where (R, C) enough of the named images show the true ground in high light."""
        suns = (ground.cosine(ground.sun(self.images[one])) for one in seen)
        return sum((one > np.cos(MOST_INCIDENCE)).astype(int) for one in suns) >= LEAST_IMAGES


def steepness(error: np.ndarray, gsd: float) -> float:
    """Return the root mean square of the slopes of errors of heights (R, C), degrees."""
    tilt = np.hypot(*slopes_of(error, gsd))[EDGE:-EDGE, EDGE:-EDGE]
    return float(np.degrees(np.arctan(np.sqrt(np.nanmean(tilt**2)))))


def between_pixels(error: np.ndarray, gsd: float, pixel: float) -> float:
    """Return that of the slopes between neighbouring means over a pixel, whole cells, degrees."""
    pixels = over_pixels(error, gsd, pixel) / (pixel_side(gsd, pixel) * gsd)
    square = sum(np.nanmean(np.diff(pixels, axis=axis) ** 2) for axis in (0, 1))
    return float(np.degrees(np.arctan(np.sqrt(square))))


def compared(
    workspace: Path, mission: Path, solution: str, every: int, *, limit: bool
) -> Iterator[tuple[str, list[Errors]]]:
    """Yield the errors of the maplets of both solutions, and with `limit` of true heights."""
    made, used = Workspace.open(workspace, solution), Workspace.open(workspace)
    fits = made.read_json("photoclinometry.json")["maplets"]
    truth = Truth(read_truth(mission), {one.name: one for one in made.images()}, fits)
    names = [name for name, fit in fits.items() if fit["outcome"] == "converged"][::every]
    if not names:
        raise SystemExit(f"no maplet of {solution} converged: choose another solution")
    spaces = {"solution in use": used, solution: made}
    if limit:
        spaces[LIMIT] = on_true_heights(workspace, used, truth, names)
    for title, space in spaces.items():
        yield title, [truth.errors(Made.of(space, name), name) for name in names]


def on_true_heights(
    workspace: Path, used: Workspace, truth: Truth, names: Sequence[str]
) -> Workspace:
    """Solve the named maplets of a workspace with their true heights as constraints."""
    if (workspace / "solutions" / LIMIT).is_dir():
        timed(["solution", "remove", workspace, LIMIT])
    with TemporaryDirectory() as folder:
        command = ["spc", "lithos", workspace, "--start", "shape", "--constraint", "maps"]
        for name in names:
            maplet, path = used.maplet(name), Path(folder) / f"{name}.MAP"
            height = heights_in_frame(truth.body, maplet.grid, truth.planted.similarity)
            write_maplet(path, replace(maplet, height=height))
            command += ["--only", name, "--map", path]
        sigma = f"{TRUE_SIGMA * maplet.grid.gsd:.6f}"
        timed([*command, "--map-sigma", sigma, "--as", LIMIT])
    return Workspace.open(workspace, LIMIT)


def lines(title: str, found: Sequence[Errors]) -> Iterator[str]:
    """Yield what is printed of one solution."""
    table = {
        name: np.array([getattr(one, name) for one in found])
        for name in (
            "images",
            "pixel",
            "usual_pixel",
            "height",
            "slope",
            "seen_slope",
            "pixel_slope",
        )
    }
    pixels = table["height"] / table["pixel"]
    typical, ninth, most = np.quantile(pixels, [0.5, 0.9, 1.0])
    heights, slopes, seen, coarse = (
        np.sqrt(np.mean(table[name] ** 2))
        for name in ("height", "slope", "seen_slope", "pixel_slope")
    )
    pixel = np.median(table["pixel"])
    yield f"{title}: {len(found)} maplets, best pixels of {pixel:.2f} m (median)"
    yield (
        f"  heights {heights:.3f} m; in pixels median {typical:.2f}, 90 % {ninth:.2f}, largest "
        f"{most:.2f}, more than {MOST_PX:g}: {np.mean(pixels > MOST_PX):.1%} (goals "
        f"{TYPICAL_PX:g}, never more than {MOST_PX:g})"
    )
    middle = np.median(table["slope"])
    yield (
        f"  slopes {slopes:.2f} deg, median of maplets {middle:.2f}; against means over cells "
        f"{seen:.2f}, {np.median(table['seen_slope']):.2f} (goal {SLOPES_DEG:g})"
    )
    yield (
        f"  between means over a pixel of {np.median(table['usual_pixel']):.2f} m (median) "
        f"{coarse:.2f}, {np.median(table['pixel_slope']):.2f}"
    )
    if len(tilts := np.abs(np.concatenate([one.tilts for one in found]))):
        pull, one, two = np.sqrt(np.mean(tilts**2)), np.mean(tilts < 1.0), np.mean(tilts < 2.0)
        yield f"  of cells: pull {pull:.2f}, within one sigma {one:.2f}, two {two:.2f}"
    albedo = [vars(one.albedo) for one in found if one.albedo is not None]
    if albedo:
        yield from albedo_lines(
            {name: np.array([one[name] for one in albedo]) for name in albedo[0]}
        )
    yield from by_images(found)


def by_images(found: Sequence[Errors]) -> Iterator[str]:
    """Yield slopes and albedo of maplets by the number of their images."""
    for least, most in pairwise(GROUPS):
        some = [one for one in found if least <= one.images < most]
        right = [one.albedo.correlation for one in some if one.albedo is not None]
        if right:
            slope = np.median([one.slope for one in some])
            yield (
                f"    {least} images or more: {len(some)} maplets, slopes {slope:.2f} deg, "
                f"albedo {np.median(right):.3f}"
            )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of both solutions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--mission", type=Path, required=True)
    parser.add_argument("--solution", required=True)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--limit", action="store_true")
    given = parser.parse_args(arguments)
    for title, found in compared(
        given.workspace, given.mission, given.solution, given.every, limit=given.limit
    ):
        print(*lines(title, found), sep="\n", flush=True)


if __name__ == "__main__":
    main()
