"""A workspace of maplets and mapolas on a ball, in two frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import ndimage

from fusion.workspace import new_workspace
from lidar.formats.mapolas import write_mapolas
from lidar.gridding import Mapola
from spcola.arrays import FloatArray
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid
from spcola.math import Similarity

PLANTED = Similarity.from_rotation_vector(
    np.radians([0.05, -0.08, 0.11]), [0.1, -0.2, 0.15], 1.002, "spc", "lidar"
)


RADIUS, GSD, HALF = 60.0, 0.5, 24


def terrain(seed: int, relief: float) -> FloatArray:
    noise = np.random.default_rng(seed).normal(size=(2 * HALF + 1, 2 * HALF + 1))
    rough = ndimage.gaussian_filter(noise, 1.5, mode="wrap")
    surface: FloatArray = relief * rough / rough.std()
    return surface


def made(
    folder: Path,
    directions: FloatArray,
    *,
    relief: float = 0.4,
    other: int = 0,
    planted: Similarity = PLANTED,
    filled: float = 1.0,
) -> Path:
    """A workspace with mapolas of two scans on a ball, and maplets as SPC has them.

    `other`: added to the seeds of what the lidar saw: another body. `filled`: share of the cells
    that have returns.
    """
    workspace = new_workspace(folder, body="Ball")
    mapolas = []
    for number, direction in enumerate(directions):
        name = f"AA{number:04d}"
        grid = MapletGrid.facing(RADIUS * direction, direction, GSD, HALF)
        noise = np.random.default_rng(1000 + number).normal(size=(2, *grid.shape))
        spc = Maplet(name, grid, terrain(number, relief) + 0.02 * noise[0])
        write_maplet(workspace.root / "MAPFILES" / f"{name}.MAP", spc.moved(planted))
        height = terrain(number + other, relief) + 0.01 * noise[1]
        seen = np.random.default_rng(2000 + number).random(grid.shape) < filled
        height, count = np.where(seen, height, np.nan), 3 * seen
        shares = {"one": 0.75, "two": 0.25} if number % 2 else {"two": 1.0}
        mapolas.append(Mapola(name, grid, height, count=count, scan_share=shares))
    write_mapolas(workspace.root / "mapolas", mapolas)
    return workspace.root
