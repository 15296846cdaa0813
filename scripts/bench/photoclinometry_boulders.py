"""Photoclinometry at boulders: mean profile of the error of height, and errors of the tops.

Boulders of the truth's catalogue count that are at least `--across` cells long, whose middle is
lit, and that lie with four radii around them on one maplet (that whose centre is nearest; each
counts once). Distance is from the boulder's axis in units of its elliptical outline: 1 is where it
meets the ground, along every direction. Points in outlines of other boulders of 1 m or more do not
count.

Profile: model minus truth, without its mean at three to four radii; mean of each boulder in rings,
then mean over boulders and its standard error. An apron is a positive error outside the outline.
The true height is that above the same body without boulders. Tops: the point of the grid nearest to
the axis, nothing removed; its sigma contains that of the maplet's centre, as in `truth assess`.

Errors are those of `truth assess`: the model's height at a point of its grid against the truth at
that very point, along Uz. What the grid cannot resolve counts as error, for each model alike. With
`--cells` the truth is its mean over the square of a cell about the point: that of lidar in cells.

    python scripts/bench/photoclinometry_boulders.py [--seeds 1] [--across 3] [--cells] [--work DIR]
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from maplets.means import mean_heights
from photoclinometry import prepared, solved

from fusion.truth.assessment.assessment import light_on
from fusion.truth.assessment.gather import workspace_models
from fusion.truth.assessment.model import Model
from fusion.truth.assessment.patches import patch_errors
from fusion.truth.assessment.regions import Ground, PointErrors
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.planted import Planted, read_truth
from fusion.workspace import Workspace
from spcola.grids import MapletGrid
from spcola.truth.body import TruthBody
from spcola.truth.body.relief import OUTLINE

IMPORTED = ("SPC maplets", "mapolas, registered", "fused maplets")
TRUE = "true height"
SOLUTIONS = {"images alone": "images", "images, mapolas": "lidar", "images, returns": "returns"}
# Rings, in radii; the ground whose mean error is removed; metres of other boulders.
EDGES = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
NEAR, FAR = 3.0, 4.0
OTHERS = 1.0


@dataclass(frozen=True)
class Top:
    """The point of a grid nearest to a boulder's axis: error, sigma and true height, metres."""

    error: float
    sigma: float
    height: float


@dataclass(frozen=True)
class At:
    """Points of one maplet: errors (N,), and true heights above ground without boulders, metres."""

    points: PointErrors
    relief: np.ndarray


def models_of(root: Path) -> dict[str, Model]:
    """Return the models to compare, by their titles."""
    imported = {model.name: model for model in workspace_models(Workspace.open(root))}
    made = {
        title: workspace_models(Workspace.open(root, name))[0] for title, name in SOLUTIONS.items()
    }
    return {name: imported[name] for name in IMPORTED} | made


def placed(
    planted: Planted, grids: Mapping[str, MapletGrid], across: float
) -> Iterator[tuple[str, int]]:
    """Yield the maplet and the number in the catalogue of each boulder that is wide enough."""
    body, names = planted.body(), list(grids)
    centers = np.stack([grids[name].center for name in names])
    catalogue = body.boulders
    radii = body.radius(catalogue.direction)
    places = planted.similarity.apply(radii[:, None] * catalogue.direction)
    for number, (place, diameter) in enumerate(zip(places, catalogue.diameter, strict=True)):
        name = names[int(np.argmin(np.linalg.norm(centers - place, axis=1)))]
        grid = grids[name]
        away = float(np.max(np.abs(grid.axes[:2] @ (place - grid.center))))
        whole = away + FAR * diameter / 2.0 < grid.half_size * grid.gsd
        if whole and diameter >= across * grid.gsd:
            yield name, number


def from_axis(body: TruthBody, number: int, direction: np.ndarray) -> np.ndarray:
    """Return the distance from a boulder's axis (N,) in `direction` (N, 3): 1 at its outline."""
    row = body.boulders.numbers[number]
    along, across = body.settings.radius * (direction @ row[3:9].reshape(2, 3).T).T
    return np.hypot(along, across) / OUTLINE


def compared(
    model: Model, name: str, ground: Ground, planted: Planted, *, cells: bool
) -> PointErrors:
    """Return the errors of the points of one maplet, against points or means over cells."""
    maplet = model.patch(name)
    patch = patch_errors(maplet, ground, planted.similarity)
    if not cells:
        return patch.points
    mean = mean_heights(planted.body(), maplet.grid, planted.similarity)
    known = maplet.valid & np.isfinite(patch.truth)
    return replace(patch.points, height=(maplet.height - mean)[known])


def profile(values: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the means of `values` (N,) in the rings, without that of the ground far away."""
    ring = np.digitize(distance, EDGES)
    total = np.bincount(ring, values, len(EDGES) + 1)[1:-1]
    count = np.bincount(ring, minlength=len(EDGES) + 1)[1:-1]
    far = (distance >= NEAR) & (distance < FAR)
    with np.errstate(invalid="ignore"):
        return total / count - (values[far].mean() if far.any() else np.nan)


@dataclass
class Found:
    """Profiles (metres, in the rings) and tops of boulders, by the titles of the models."""

    profiles: dict[str, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))
    tops: dict[str, list[Top]] = field(default_factory=lambda: defaultdict(list))

    def add(self, title: str, number: int, body: TruthBody, at: At) -> None:
        """Add a boulder of the catalogue, if its top is lit."""
        distance = from_axis(body, number, at.points.direction.astype(np.float64))
        top = int(np.argmin(distance))
        if not at.points.within("lit")[top]:
            return
        kept = (distance < 1.0) | ~at.points.within("boulders")
        if title == IMPORTED[0]:
            self.profiles[TRUE].append(profile(at.relief[kept], distance[kept]))
        error, sigma = at.points.height, at.points.sigma
        self.profiles[title].append(profile(error[kept], distance[kept]))
        self.tops[title].append(Top(float(error[top]), float(sigma[top]), float(at.relief[top])))


def measure(found: Found, root: Path, across: float, *, cells: bool) -> None:
    """Add the boulders of one mission, those at least `across` cells long."""
    planted, space = read_truth(root.with_name("mission")), Workspace.open(root)
    body, own = planted.body(), planted.settings.body
    bare = TruthBody(replace(own, boulders=replace(own.boulders, density_per_km2=0.0)))
    ground = Ground(body, light_on(planted, body), AssessmentSettings(smallest=OTHERS))
    grids = {name: space.maplet(name).grid for name in space.maplet_names()}
    boulders = defaultdict(list)
    for name, number in placed(planted, grids, across):
        boulders[name].append(number)
    for title, model in models_of(root).items():
        for name, numbers in boulders.items():
            points = compared(model, name, ground, planted, cells=cells)
            unit = points.direction.astype(np.float64)
            at = At(points, body.radius(unit) - bare.radius(unit))
            for number in numbers:
                found.add(title, number, body, at)


def profile_lines(found: Found) -> Iterator[str]:
    """Yield the mean profiles and their standard errors, centimetres."""
    rings = (f"{low:g} - {high:g}" for low, high in pairwise(EDGES))
    yield f"{'centimetres':20}" + "".join(f"{ring:>15}" for ring in rings)
    for title, profiles in found.profiles.items():
        rows = 100.0 * np.array(profiles)
        deviation = np.nanstd(rows, axis=0, ddof=1) / np.sqrt(np.isfinite(rows).sum(axis=0))
        pairs = zip(np.nanmean(rows, axis=0), deviation, strict=True)
        cells = (f"{mean:.2f} ± {error:.2f}" for mean, error in pairs)
        yield f"{title:20}" + "".join(f"{cell:>15}" for cell in cells)


def top_lines(found: Found) -> Iterator[str]:
    """Yield the errors of the tops, metres, and the shares within one and two sigma."""
    heads = ("boulders", "height", "mean", "rms", "sigma", "1 sigma", "2 sigma")
    yield f"{'tops':20}" + "".join(f"{head:>10}" for head in heads)
    for title, tops in found.tops.items():
        error, sigma, height = np.array([(top.error, top.sigma, top.height) for top in tops]).T
        shares = [np.mean(np.abs(error) <= k * sigma) for k in (1, 2)]
        rms = [np.sqrt(np.mean(values**2)) for values in (error, sigma)]
        numbers = [height.mean(), error.mean(), *rms]
        yield (
            f"{title:20}{len(tops):10}"
            + "".join(f"{number:10.3f}" for number in numbers)
            + "".join(f"{share:10.2f}" for share in shares)
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables of all missions together."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--across", type=float, default=3.0)
    parser.add_argument("--cells", action="store_true")
    parser.add_argument("--work", type=Path)
    given = parser.parse_args(arguments)
    found = Found()
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(1, given.seeds + 1):
            root = prepared(given.work or Path(temporary), "mini", seed, 1.0)
            for _ in solved(root, 1.0):
                pass
            measure(found, root, given.across, cells=given.cells)
    for line in (*profile_lines(found), *top_lines(found)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
