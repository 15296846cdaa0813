"""How long windows and tiles of a large bigmap take: the limit is 100 ms for the 95th percentile.

    python -m scripts.bench.service_views [SIZE]

A bigmap of SIZE² points (5001) with sigma is made, and read as the service does: windows of
512 × 512 points, tiles of 256² as PNG at every level, values and profiles. "not cached" is with the
files' pages dropped from the system's memory before each reading.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from fusion.service.views.surfaces import (
    LayerCache,
    Surface,
    SurfaceKind,
    open_surface,
    png_of,
    profile,
    value_at,
)
from fusion.workspace import Workspace
from fusion.workspace.settings import Settings
from spcola.formats.maplets import write_maplet
from spcola.grids import Maplet, MapletGrid

LIMIT_MS = 100.0
WINDOW = 512
TIMES = 60


def made(folder: Path, size: int) -> Workspace:
    """Return a workspace with bigmaps of one site, of maplets and of fused maplets."""
    workspace = Workspace.create(folder / "ws", Settings())
    half = size // 2
    grid = MapletGrid.facing([250.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.05, half)
    rng = np.random.default_rng(1)
    height = gaussian_filter(rng.normal(size=grid.shape), 8.0) * 40.0
    height[rng.random(grid.shape) < 0.02] = np.nan
    sigma = np.where(np.isfinite(height), rng.uniform(0.01, 0.1, grid.shape), np.nan)
    albedo = rng.uniform(0.8, 1.2, grid.shape)
    root = workspace.root / "bigmaps"
    (root / "maplets").mkdir()
    for path, lift in ((root / "SITE.MAP", 0.0), (root / "maplets" / "SITE.MAP", 0.3)):
        bigmap = Maplet("SITE", grid, height + lift, albedo, sigma)
        write_maplet(path, bigmap, sigma_companion=True)
    return workspace


def forget(folder: Path) -> None:
    """Drop the pages of all files in a folder from the system's memory."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb") as stream:
                os.fsync(stream.fileno())
                os.posix_fadvise(stream.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def row(title: str, act: Callable[[], object], before: Callable[[], None] = lambda: None) -> float:
    """Print percentiles of the time of `act`; return the 95th, ms."""
    taken = []
    for _ in range(TIMES):
        before()
        begun = time.perf_counter()
        act()
        taken.append(1e3 * (time.perf_counter() - begun))
    middle, high = np.percentile(taken, (50, 95))
    print(f"{title:44} {middle:9.2f} {high:9.2f} {max(taken):9.2f}", flush=True)
    return float(high)


def main(size: int) -> None:
    """Print the table."""
    rng = np.random.default_rng(2)
    with tempfile.TemporaryDirectory() as folder:
        workspace = made(Path(folder), size)
        cache = LayerCache()

        def opened() -> Surface:
            return open_surface(workspace, SurfaceKind.BIGMAP, "SITE:fused", cache=cache)

        def window(layer: str) -> Callable[[], object]:
            def act() -> object:
                low = rng.integers(0, size - WINDOW, 2).tolist()
                spans = [(one, one + WINDOW) for one in low]
                return opened().window(layer, rows=spans[0], columns=spans[1])

            return act

        print(f"{f'bigmap of {size} × {size} points; ms':44} {'median':>9} {'p95':>9} {'most':>9}")
        root = workspace.root / "bigmaps"
        worst = 0.0
        for layer in ("height", "sigma", "albedo", "difference", "hillshade", "slope"):
            title = f"window {WINDOW}², {layer}"
            worst = max(worst, row(title, window(layer)))
            worst = max(worst, row(f"{title}, not cached", window(layer), lambda: forget(root)))
        begun = time.perf_counter()
        described = opened().describe()
        print(f"first description (overview levels are made): {time.perf_counter() - begun:.2f} s")
        for each in described["levels"]:

            def tile(level: int = each["level"], tiles: int = each["tiles"]) -> bytes:
                surface, at = opened(), rng.integers(0, tiles, 2).tolist()
                values = surface.tile("height", level, *at)
                return png_of(values, "height", (-5.0, 5.0))

            worst = max(worst, row(f"tile as PNG, level {each['level']}", tile))
        reach = 0.9 * size // 2 * 0.05
        row("description again", lambda: opened().describe())
        row("value at a point", lambda: value_at(opened(), *rng.uniform(-reach, reach, 2)))
        row("profile across", lambda: profile(opened(), (-reach, -reach), (reach, reach)))
    print(f"worst p95 of windows and tiles {worst:.1f} ms; limit {LIMIT_MS:g} ms")
    sys.exit(worst > LIMIT_MS)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5001)
