"""Maplets from images against the truth, each in pixels of the best images that show it.

Of a solution that `spcola spc lithos` made of a synthetic mission, printed next to the maplets
of the solution in use.

- heights: each maplet's root mean square of the errors about their mean, in pixels and metres.
- slopes: errors of the slopes of ground as wide as a pixel.
- albedo: correlation of the relative albedo of each maplet with the truth where three of its images
  or more show the ground with an incidence below 60 degrees, and its multiple correlation with both
  slopes; that of the true albedo with the true slopes stands next to it.

    python scripts/bench/photoclinometry_maplets.py WORKSPACE --mission DIR --solution NAME
        [--every 1]

Only every so many converged maplets are compared.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fusion.truth.planted import Planted, read_truth
from fusion.workspace import Workspace
from spcola.camera import SpcImage
from spcola.grids import Maplet
from spcola.heights.slopes import slopes_of
from spcola.photometry.ground import Ground
from spcola.truth.body import TruthBody
from spcola.truth.solution import heights_in_frame

# Goals of the issue: typical and largest height error (pixels), slopes (degrees), albedo.
TYPICAL_PX, MOST_PX, SLOPES_DEG, ALBEDO, TOPOGRAPHY = 1.0, 3.0, 3.0, 0.9, 0.1
# Incidence of the goal for albedo, and images that have to show the ground like that.
MOST_INCIDENCE, LEAST_IMAGES = np.radians(60.0), 3
# Points at the edges of maplets that are not compared: their slopes are one-sided.
EDGE = 4


@dataclass(frozen=True)
class Errors:
    """Of one maplet.

    Parameters
    ----------
    pixel : float
        Of the best image that shows it, metres.
    height, slope : float
        Root mean square: heights about their mean, metres; slopes of a pixel's width, degrees.
    albedo, topography, true_topography : float
        Correlation of the albedo with the truth, multiple correlation of it with both slopes, and
        that of the truth; NaN where too little ground is lit well.
    """

    pixel: float
    height: float
    slope: float
    albedo: float
    topography: float
    true_topography: float


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

    def errors(self, maplet: Maplet, name: str) -> Errors:
        """Compare a maplet of a solution, solved or not, with the truth."""
        fits = self.fits[name]["images"].items()
        seen = {image: fit for image, fit in fits if fit["fit"] != "not-seen"}
        pixel = min(fit["pixel_m"] for fit in seen.values())
        inner = slice(EDGE, -EDGE)
        height = heights_in_frame(self.body, maplet.grid, self.planted.similarity)
        wrong = (maplet.height - height)[inner, inner]
        gsd = maplet.grid.gsd
        width = max(1, round(pixel / gsd))
        along_x = wrong[:-width, width:] - wrong[:-width, :-width]
        along_y = wrong[width:, :-width] - wrong[:-width, :-width]
        tilt = np.hypot(along_x, along_y) / (width * gsd)
        slope = np.degrees(np.arctan(np.sqrt(np.nanmean(tilt**2))))
        return Errors(
            pixel, float(np.nanstd(wrong)), float(slope), *self.albedo(maplet, height, seen)
        )

    def albedo(
        self, maplet: Maplet, height: np.ndarray, seen: Mapping[str, Any]
    ) -> tuple[float, float, float]:
        """Return the correlation of the albedo with the truth, and both with slopes."""
        ground = Ground.of(maplet.grid, height)
        well = sum(
            (ground.cosine(ground.sun(self.images[one])) > np.cos(MOST_INCIDENCE)).astype(int)
            for one in seen
        )
        back = self.planted.similarity.inverse()
        places = back.apply(ground.points.reshape(-1, 3))
        true = self.body.albedo(places).reshape(height.shape)
        good = (well >= LEAST_IMAGES) & np.isfinite(maplet.albedo) & np.isfinite(maplet.height)
        good[:EDGE], good[-EDGE:], good[:, :EDGE], good[:, -EDGE:] = False, False, False, False
        if good.mean() < 0.1:
            return (float("nan"),) * 3
        return (
            float(np.corrcoef(maplet.albedo[good], true[good])[0, 1]),
            explained(maplet.albedo, maplet.height, good, maplet.grid.gsd),
            explained(true, height, good, maplet.grid.gsd),
        )


def explained(albedo: np.ndarray, height: np.ndarray, good: np.ndarray, gsd: float) -> float:
    """Return the multiple correlation of albedo with both slopes."""
    slopes = np.array(slopes_of(height, gsd))
    good = good & np.isfinite(slopes).all(axis=0)
    rows = np.stack([*slopes[:, good], np.ones(int(good.sum()))], axis=1)
    left = albedo[good] - rows @ np.linalg.lstsq(rows, albedo[good], rcond=None)[0]
    return float(np.sqrt(max(1.0 - left.var() / albedo[good].var(), 0.0)))


def compared(
    workspace: Path, mission: Path, solution: str, every: int
) -> Iterator[tuple[str, list[Errors]]]:
    """Yield the errors of the maplets of both solutions."""
    made, used = Workspace.open(workspace, solution), Workspace.open(workspace)
    fits = made.read_json("photoclinometry.json")["maplets"]
    truth = Truth(read_truth(mission), {one.name: one for one in made.images()}, fits)
    names = [name for name, fit in fits.items() if fit["outcome"] == "converged"][::every]
    for title, space in (("solution in use", used), (solution, made)):
        yield title, [truth.errors(space.maplet(name), name) for name in names]


def lines(title: str, found: Sequence[Errors]) -> Iterator[str]:
    """Yield what is printed of one solution."""
    table = {name: np.array([getattr(one, name) for one in found]) for name in vars(found[0])}
    pixels = table["height"] / table["pixel"]
    typical, ninth, most = np.quantile(pixels, [0.5, 0.9, 1.0])
    heights, slopes = (np.sqrt(np.mean(table[name] ** 2)) for name in ("height", "slope"))
    yield f"{title}: {len(found)} maplets, pixels of {np.median(table['pixel']):.2f} m (median)"
    yield (
        f"  heights {heights:.3f} m; in pixels median {typical:.2f}, 90 % {ninth:.2f}, "
        f"largest {most:.2f} (goals {TYPICAL_PX:g}, largest {MOST_PX:g})"
    )
    middle = np.median(table["slope"])
    yield f"  slopes {slopes:.2f} deg, median of maplets {middle:.2f} (goal {SLOPES_DEG:g})"
    known = np.isfinite(table["albedo"])
    if known.any():
        middle, low = np.quantile(table["albedo"][known], [0.5, 0.1])
        yield (
            f"  albedo of {known.sum()}: correlation with the truth {middle:.3f} (median), "
            f"{low:.3f} (tenth) (goal {ALBEDO:g})"
        )
        own, true = (np.nanmedian(table[name]) for name in ("topography", "true_topography"))
        yield f"  with slopes {own:.3f}, the true albedo {true:.3f} (goal {TOPOGRAPHY:g})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of both solutions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("workspace", type=Path)
    parser.add_argument("--mission", type=Path, required=True)
    parser.add_argument("--solution", required=True)
    parser.add_argument("--every", type=int, default=1)
    given = parser.parse_args(arguments)
    for title, found in compared(given.workspace, given.mission, given.solution, given.every):
        print(*lines(title, found), sep="\n", flush=True)


if __name__ == "__main__":
    main()
