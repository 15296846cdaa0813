"""A workspace of a ball: maplets, fused maplets, bigmaps and a scan."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.fusing.maplets import FusedMaplet, Source, write_fused
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from lidar.formats.native import write_scan
from lidar.scans import Scan
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid

RADIUS, GSD, HALF = 60.0, 0.5, 12


def facing(longitude: float, height: float = 0.0) -> MapletGrid:
    """A grid of the ball's tangent plane, moved up by `height`."""
    normal = np.array([np.cos(longitude), np.sin(longitude), 0.0])
    return MapletGrid.facing((RADIUS + height) * normal, normal, GSD, HALF)


def ball(grid: MapletGrid, lift: float = 0.0) -> np.ndarray:
    """Heights of the ball over a grid, metres."""
    across = (grid.gsd * grid.offsets) ** 2
    level = np.linalg.norm(grid.center)
    return np.sqrt((RADIUS + lift) ** 2 - across[:, None] - across[None, :]) - level


def unit_vectors(count: int) -> np.ndarray:
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def ball_workspace(root: Path) -> Workspace:
    """Make three maplets with fused ones 0.2 m above them, a site, and returns all around."""
    made = Workspace.create(root, Settings().with_table("body", name="Ball"))
    fused = []
    for number, longitude in enumerate((0.0, 0.5, 3.0)):
        name, grid = f"AA{number:04d}", facing(longitude)
        rng = np.random.default_rng(number)
        albedo = rng.uniform(0.8, 1.2, grid.shape)
        write_maplet(made.maplet_path(name), Maplet(name, grid, ball(grid), albedo))
        # The registered grid is another one; the surface is 0.2 m higher.
        moved = facing(longitude, 0.3)
        height = ball(moved, 0.2)
        fused.append(
            FusedMaplet(
                name, moved, height, albedo, np.full(grid.shape, 0.02 * (number + 1)),
                count=np.full(grid.shape, number), source=np.full(grid.shape, Source.BOTH),
            )
        )  # fmt: skip
    write_fused(made.root / "fused", fused)
    (made.root / "bigmaps" / "maplets").mkdir()
    for folder in ("bigmaps", "bigmaps/maplets"):
        grid = facing(0.2)
        lift = 0.0 if "/" in folder else 0.1
        site = Maplet("SITE", grid, ball(grid, lift), sigma=np.full(grid.shape, 0.01))
        write_maplet(made.root / folder / "SITE.MAP", site, sigma_companion=True)
    scan = Scan.of_points("one", RADIUS * unit_vectors(40_000), body="Ball")
    write_scan(made.scan_path("one"), [scan])
    return made
