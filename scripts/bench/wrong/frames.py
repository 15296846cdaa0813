#!/usr/bin/env python3
"""The search for the lidar's frame: planted and found frames, over bodies.

For each body random rotations, rotations about Z, mirrored axes, units and their combinations; the
whole body, a hemisphere and a few tracks; and surfaces without a true frame: a cloud, a sphere,
inverted relief, other bodies. Printed for each: whether a frame was found, the error of the
orientation in degrees, the seconds of one core, and the program's text. At the end the share
found, the largest error, and the rate of false alarms.

    python scripts/bench/wrong/frames.py [WORKSPACE ...] [--shape FILE ...] [--turns 4] [--pairs 0]

Workspaces are of right missions with their scans imported. Shapes (metres or, by default,
kilometres) are sampled by a lidar with noise of 0.1 % of the radius, against the same shape with
errors of 0.3 %. `--pairs` tries so many pairs of different random bodies.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fusion.registration.search import search_frames
from fusion.registration.search.orientations import apart_deg
from fusion.scene.geolocation import located_store
from fusion.stages.register.frame_search import surface_points
from fusion.workspace import Workspace
from spcola.formats.shapes import read_shape
from spcola.math import lattice
from spcola.shape import sample_surface
from wrong.alter import Floats, other_radius

RETURNS = 400_000
NOISE, ERRORS = 0.001, 0.003


@dataclass(frozen=True)
class Row:
    """One search: the body, what was planted, and what was found."""

    body: str
    how: str
    right: bool
    found: bool
    error_deg: float
    significance: float
    seconds: float
    text: str

    @property
    def as_wanted(self) -> bool:
        """Whether a true frame was found to 1°, or no frame without one."""
        return self.found == self.right and not self.error_deg > 1.0


@dataclass(frozen=True)
class Body:
    """A lidar and an SPC surface of one body in one frame, (N, 3) and (M, 3), metres."""

    name: str
    lidar: Floats
    surface: Floats

    def row(self, how: str, lidar: Floats, planted: Floats | None) -> Row:
        """Search for the frame of `lidar`, which is that of the body changed by `planted`."""
        begin = time.process_time()
        search = search_frames(lidar, self.surface)
        seconds = time.process_time() - begin
        error = np.nan
        if planted is not None and search.candidates:
            size = np.cbrt(abs(np.linalg.det(planted)))
            found = search.candidates[0].placement.matrix
            error = float(apart_deg(planted.T / size, found[None])[0])
        return Row(
            self.name, how, planted is not None, search.found, error, search.significance,
            seconds, search.text,
        )  # fmt: skip


def body_of_workspace(path: Path) -> Body:
    """Lidar and surface of a workspace."""
    workspace = Workspace.open(path)
    settings = workspace.settings()
    store = located_store(workspace, settings.mapolas, settings.spin, settings.spice)
    return Body(path.name, store.spread(RETURNS), surface_points(workspace, settings))


def body_of_shape(path: Path, unit: str, seed: int = 1) -> Body:
    """Return a shape sampled by a lidar, and with correlated errors as of SPC."""
    mesh = read_shape(path, unit="m" if unit == "m" else "km")
    samples = sample_surface(mesh, 0.012 * mesh.mean_radius).points
    draw = np.random.default_rng(seed)
    lidar = samples[draw.permutation(len(samples))[:30_000]]
    lidar = lidar + NOISE * mesh.mean_radius * draw.normal(size=lidar.shape)
    units = samples / np.linalg.norm(samples, axis=1, keepdims=True)
    errors = other_radius(units, 0.0, ERRORS, seed)
    return Body(path.stem[:16], lidar, samples * (1.0 + errors)[:, None])


def planted(turns: int, seed: int = 1) -> Iterator[tuple[str, Floats]]:
    """Yield names and matrices of the planted transforms of a lidar."""
    draw = np.random.default_rng(seed)
    for angle in (0.0, 2.9, 10.0, 90.0, 180.0):
        yield f"turn {angle:g} z", Rotation.from_euler("z", angle, degrees=True).as_matrix()
    for axis, flip in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        yield f"mirror {axis}", np.diag(flip)
    yield "unit 0.001", 1e-3 * np.eye(3)
    yield "axes yzx", np.eye(3)[[1, 2, 0]]
    for number in range(turns):
        axis = draw.normal(size=3)
        angle = draw.uniform(1.0, 180.0)
        matrix = Rotation.from_rotvec(np.radians(angle) * axis / np.linalg.norm(axis)).as_matrix()
        yield f"turn {angle:.1f} random", matrix
        if number % 2:
            flip = np.diag(1.0 - 2.0 * np.eye(3)[number // 2 % 3])
            yield f"mirror, turn {angle:.1f}, unit 1000", 1e3 * matrix @ flip


def rows_of(body: Body, turns: int, seed: int = 1) -> Iterator[Row]:
    """Yield the searches for one body: first with a true frame, then without."""
    for how, matrix in planted(turns, seed):
        yield body.row(how, body.lidar @ matrix.T, matrix)
    draw = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    radius = np.linalg.norm(body.lidar, axis=1, keepdims=True)
    units = body.lidar / radius
    north = body.lidar[units[:, 2] > 0.0]
    yield body.row("hemisphere, turned", north @ turn.T, turn)
    circles = Rotation.random(3, random_state=seed).as_matrix()[:, 0]
    tracks = body.lidar[(np.abs(units @ circles.T) < 0.01).any(axis=1)]
    yield body.row("three tracks, turned", tracks @ turn.T, turn)
    middle = float(np.median(radius))
    wrong = draw.normal(size=units.shape)
    wrong /= np.linalg.norm(wrong, axis=1, keepdims=True)
    spread = draw.uniform(radius.min(), radius.max(), radius.shape)
    yield body.row("cloud", wrong * spread, None)
    yield body.row("sphere", units * (middle + 0.03 * draw.normal(size=radius.shape)), None)
    yield body.row("inverted relief", units * np.maximum(2.0 * middle - radius, 1.0), None)
    other = other_radius(units, middle, float(radius.std()), seed)
    yield body.row("another body", units * np.maximum(other, 0.2 * middle)[:, None], None)


def pair_rows(count: int) -> Iterator[Row]:
    """Yield searches for the lidar of one random body on another, `count` pairs."""
    for seed in range(count):
        surface, seen = lattice(30_000), lattice(12_001)
        relief = 2.0 + 6.0 * np.random.default_rng(seed).random()
        lidar = seen * other_radius(seen, 50.0, relief, 2 * seed)[:, None]
        body = Body(
            f"pair {seed}",
            lidar,
            surface * other_radius(surface, 50.0, relief, 2 * seed + 1)[:, None],
        )
        yield body.row("another body", lidar, None)


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the summary of the rows."""
    right, wrong = [row for row in rows if row.right], [row for row in rows if not row.right]
    if right:
        found = [row for row in right if row.found]
        errors = [row.error_deg for row in found]
        median, worst = (np.median(errors), max(errors)) if errors else (np.nan, np.nan)
        yield (
            f"found {len(found)} of {len(right)}; orientation off by {median:.2f} deg (median), "
            f"{worst:.2f} deg at most (wanted: 1)"
        )
    if wrong:
        yield f"false alarms: {sum(row.found for row in wrong)} of {len(wrong)} (wanted: < 1 %)"
    yield f"seconds of one core: {max(row.seconds for row in rows):.1f} at most (wanted: 60)"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("workspaces", type=Path, nargs="*")
    parser.add_argument("--shape", type=Path, nargs="*", default=[])
    parser.add_argument("--unit", choices=("km", "m"), default="km", help="of the shapes")
    parser.add_argument("--turns", type=int, default=4, help="random turns of each body")
    parser.add_argument("--pairs", type=int, default=0, help="pairs of different random bodies")
    options = parser.parse_args()
    bodies = [body_of_workspace(path) for path in options.workspaces]
    bodies += [body_of_shape(path, options.unit) for path in options.shape]
    rows = []
    print(f"{'body':17}{'lidar':34}{'found':>6}{'off, deg':>9}{'sigmas':>8}{'s':>6}  text")
    for source in (*(rows_of(body, options.turns) for body in bodies), pair_rows(options.pairs)):
        for row in source:
            rows.append(row)
            mark = "" if row.as_wanted else "  WRONG"
            print(
                f"{row.body:17}{row.how:34}{row.found!s:>6}{row.error_deg:>9.2f}"
                f"{row.significance:>8.1f}{row.seconds:>6.1f}  {row.text}{mark}",
                flush=True,
            )
    print(*summary(rows), sep="\n")


if __name__ == "__main__":
    main()
