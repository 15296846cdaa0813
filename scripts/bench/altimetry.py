#!/usr/bin/env python3
"""Speed of the import of a mission's lidar, and of making mapolas of it.

A synthetic mission is streamed: scans of the preset `mission` (1.2 million shots each) are written
as OLA L2 in batches (the largest are 14 GB on disk), imported with the real command from a cold
cache, and removed. By default the 64 scans nearest to the north pole are taken, so that returns are
as dense there as with all 640 (`--scans 640`). Then the real command makes mapolas of 99 × 99
points at 20 cm over all that they cover, again with another pole, and again with the first.

Printed: the rate of the import and the streaming rate of the disk; returns gridded per second (one
return falls into several mapolas) and per second of the mission; the ratio of an update; cost
against returns over two decades; whether mapolas of the store equal those of raw points, and
whether they are unchanged after the second change of the pole; the median kernel and its peers.

    python scripts/bench/altimetry.py [--scans 64] [--work DIR] [--parts store kernel]
"""

from __future__ import annotations

import argparse
import hashlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.stats import binned_statistic_2d
from truth import timed

from fusion.runtime import Progress, ThreadExecutor
from fusion.scene.geolocation import ReturnSource, gridding_options
from fusion.stages.mapolas import mapola_grids
from fusion.truth.generation import Site
from fusion.truth.presets import MissionSettings
from fusion.truth.scans import day_biases, plan_observations, write_observations
from fusion.truth.solution import write_shape
from fusion.truth.work import Work
from fusion.workspace import SETTINGS_FILE, Workspace
from fusion.workspace.settings import write_settings
from lidar.formats.reader import read_scan
from lidar.gridding import grid_returns
from lidar.gridding.cells import sort_into_cells
from lidar.scan_store import ScanStore
from lidar.scans import Returns
from lidar.truth import Observation
from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.truth.body import TruthBody
from spcola.truth.campaign import plan_passes

# Scans that one command imports: the store is then as large as those before and these together.
BATCHES, BATCH = (1, 7, 56), 64
RECORD_BYTES = 186
QUANTUM_M = 5e-5
BARS = {"import": 5.0, "mapolas": 10.0, "update": 1.3, "kernel": 50.0, "polars": 4, "scipy": 10}
KERNEL_POINTS, KERNEL_SIDE = 20_000_000, 1001


def planned(root: Path, scans: int) -> tuple[Work, dict[str, Observation]]:
    """Return the mission being made, and its scans from the north pole on."""
    settings = MissionSettings.mission(1)
    site = Site(root)
    for folder in (site.lidar, site.spc, *(site.spc / name for name in ("SHAPEFILES",))):
        folder.mkdir(parents=True, exist_ok=True)
    body = TruthBody(settings.body)
    work = Work(settings, site, body, ThreadExecutor(), Progress())
    passes = sorted(
        plan_passes(settings.passes, work.random("passes")),
        key=lambda at: -at.latitude,
    )
    return work, plan_observations(passes[:scans], settings)


def cold(paths: Sequence[Path]) -> None:
    """Take files out of the cache of the operating system."""
    for path in paths:
        descriptor = os.open(path, os.O_RDONLY)
        os.fsync(descriptor)
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        os.close(descriptor)


def streaming_rate(paths: Sequence[Path]) -> float:
    """Return the bytes per second at which files are read from the disk and discarded."""
    cold(paths)
    start, size = time.perf_counter(), 0
    buffer = bytearray(1 << 24)
    for path in paths:
        with path.open("rb", buffering=0) as file:
            while count := file.readinto(buffer):
                size += count
    return size / (time.perf_counter() - start)


class Store:
    """A workspace that grows batch by batch, and the cost of that."""

    def __init__(self, root: Path, scans: int) -> None:
        self.work, self.observations = planned(root, scans)
        self.path = root / "workspace"
        self.imports: list[tuple[float, int]] = []
        self.peak = 0.0
        self.rates: list[float] = []
        write_shape(self.work)
        timed(["init", self.path, "--spc", self.work.site.spc, "--body", "Truth"])
        self.put("mapolas", source="cover", gsd_m=0.2, half_size=49, overlap=0.3, adjust=False)

    def put(self, table: str, **values: object) -> None:
        """Change settings of the workspace."""
        settings = Workspace.open(self.path).settings().with_table(table, **values)
        write_settings(self.path / SETTINGS_FILE, settings)

    def batches(self) -> Iterator[list[Path]]:
        """Write, import and remove the scans, batch by batch; yield before they are removed."""
        names = list(self.observations)
        sizes = [*BATCHES, *[BATCH] * len(names)]
        while names:
            size = sizes.pop(0)
            chosen, names = names[:size], names[size:]
            scans = {name: self.observations[name] for name in chosen}
            write_observations(self.work, scans, day_biases(scans, self.work.settings))
            paths = sorted(self.work.site.lidar.iterdir())
            self.rates.append(streaming_rate(paths))
            cold(paths)
            cost = timed(["import", self.path, *paths])
            self.imports.append((cost["seconds"], sum(path.stat().st_size for path in paths)))
            self.peak = max(self.peak, cost["gib"])
            yield paths
            for path in paths:
                path.unlink()

    @property
    def returns(self) -> int:
        """Number of returns in the store."""
        return len(ScanStore(Workspace.open(self.path).scan_paths()))

    def mapolas(self) -> tuple[float, float, int, int]:
        """Make the mapolas; return seconds, peak GiB, returns gridded, and how many mapolas."""
        cost = timed(["mapolas", self.path, "--force"])
        workspace = Workspace.open(self.path)
        counts = [int(workspace.mapola(n).count.sum()) for n in workspace.mapola_names()]
        return cost["seconds"], cost["gib"], sum(counts), len(counts)

    def digest(self) -> str:
        """Return the digest of all mapolas."""
        found = hashlib.sha256()
        for path in sorted(Workspace.open(self.path).mapola_paths()):
            found.update(path.read_bytes())
        return found.hexdigest()


def against_raw(store: Store, paths: Sequence[Path]) -> str:
    """Compare mapolas of the store with mapolas of all points of the files.

    A shift of a coordinate by half a quantum may move a return into another cell, or to the other
    side of a median; points rounded to quanta must give identical heights.
    """
    workspace = Workspace.open(store.path)
    settings = workspace.settings()
    points = np.concatenate([read_scan(path).points for path in paths])
    points = points[np.isfinite(points).all(axis=1)]
    source = ReturnSource(ScanStore(workspace.scan_paths()), gridding_options(settings.mapolas))
    apart: dict[str, list[FloatArray]] = {"raw": [], "rounded": []}
    for name, grid in mapola_grids(workspace, settings).items():
        gridding, _ = source.gridded(name, grid)
        if gridding.mapola.coverage < 0.9:
            continue
        for kind, there in (("raw", points), ("rounded", np.rint(points / QUANTUM_M) * QUANTUM_M)):
            near = there[source.options.box(grid).holds(there)]
            none = np.zeros(len(near), dtype=np.int32)
            returns = Returns(near, np.full(len(near), np.nan), none, ("raw",))
            other = grid_returns(name, grid, returns, options=source.options).mapola
            apart[kind].append(np.abs(other.height - gridding.mapola.height))
        if len(apart["raw"]) == 5:
            break
    raw, rounded = (np.concatenate([part.ravel() for part in apart[kind]]) for kind in apart)
    raw, rounded = raw[np.isfinite(raw)], rounded[np.isfinite(rounded)]
    return (
        f"{len(apart['raw'])} mapolas of the store against all points of the files: "
        f"{np.mean(raw <= QUANTUM_M):.2%} of {raw.size} heights within the quantum of "
        f"{QUANTUM_M:.0e} m, {raw.max():.1e} m at most; of points rounded to quanta: "
        f"{rounded.max():.1e} m at most"
    )


def import_lines(store: Store) -> Iterator[str]:
    """Yield the speed of each import."""
    disk = float(np.median(store.rates)) / 1e6
    for seconds, size in store.imports:
        rate = size / RECORD_BYTES / seconds / 1e6
        yield (
            f"import: {size / RECORD_BYTES / 1e6:.1f} M shots of OLA L2 in {seconds:.1f} s: "
            f"{rate:.2f} M/s, {rate * RECORD_BYTES:.0f} MB/s"
        )
    yield (
        f"bar: {BARS['import']:.0f} M/s, or 60 % of the disk, which streams {disk:.0f} MB/s = "
        f"{0.6 * disk / RECORD_BYTES:.2f} M/s; peak {store.peak:.2f} GiB (bar 2)"
    )


def store_lines(root: Path, scans: int) -> Iterator[str]:
    """Yield the cost of the store and its mapolas."""
    store = Store(root, scans)
    decades: list[tuple[int, float, int]] = []
    for paths in store.batches():
        done = len(store.imports)
        if done <= len(BATCHES) and sum(BATCHES[:done]) < scans:
            seconds, _, gridded, _ = store.mapolas()
            decades.append((store.returns, seconds, gridded))
        if done == 1:
            yield against_raw(store, paths)
    yield from import_lines(store)
    seconds, peak, gridded, count = store.mapolas()
    decades.append((store.returns, seconds, gridded))
    first = store.digest()
    yield (
        f"mapolas: {count} of {store.returns / 1e6:.1f} M returns in {seconds:.0f} s: "
        f"{gridded / seconds / 1e6:.2f} M returns/s gridded (bar {BARS['mapolas']:.0f}), "
        f"{store.returns / seconds / 1e6:.2f} M/s of the mission, peak {peak:.2f} GiB (bar 4)"
    )
    store.put("spin", shift_pole_ra_deg=0.01, shift_pole_dec_deg=-0.005, rate_deg_per_day=2011.1)
    again, peak, _, _ = store.mapolas()
    yield (
        f"another pole, all mapolas again: {again:.0f} s, {again / seconds:.2f} × the mapolas "
        f"alone (bar {BARS['update']}), peak {peak:.2f} GiB; the same bytes: "
        f"{store.digest() == first}"
    )
    store.put("spin", shift_pole_ra_deg=0.0, shift_pole_dec_deg=0.0)
    store.mapolas()
    yield f"and back: the same bytes as at first: {store.digest() == first}"
    yield "cost: " + "; ".join(
        f"{returns / 1e6:.1f} M returns, {gridded / 1e6:.1f} M gridded: {seconds:.1f} s "
        f"({1e9 * seconds / max(gridded, 1):.0f} ns each)"
        for returns, seconds, gridded in decades
    )


def by_spcola(points: FloatArray) -> FloatArray:
    """Return median heights as in gridding, for a frame of any direction."""
    half = KERNEL_SIDE // 2
    grid = MapletGrid(np.zeros(3), np.eye(3), 1.0, half)
    return sort_into_cells(grid, points, np.inf).middle


def by_polars(points: FloatArray) -> FloatArray:
    """Return median heights by a data frame, after computing the cells."""
    polars = import_module("polars")
    x, y, z = points.T
    cell = _cells(x, y)
    frame = polars.DataFrame({"cell": cell, "z": z})
    found = frame.group_by("cell").agg(polars.col("z").median())
    result = np.full(KERNEL_SIDE**2, np.nan)
    result[found["cell"].to_numpy()] = found["z"].to_numpy()
    return result.reshape(KERNEL_SIDE, KERNEL_SIDE)


def by_scipy(points: FloatArray) -> FloatArray:
    """Return median heights by `scipy.stats`."""
    x, y, z = points.T
    half = KERNEL_SIDE / 2.0
    edges = np.linspace(-half, half, KERNEL_SIDE + 1)
    found = binned_statistic_2d(y, x, z, statistic="median", bins=[edges, edges])
    return np.asarray(found.statistic)


def _cells(x: FloatArray, y: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    half = KERNEL_SIDE // 2
    column, row = np.floor(x + 0.5).astype(np.int64), np.floor(y + 0.5).astype(np.int64)
    return (row + half) * KERNEL_SIDE + column + half


def reading(points: FloatArray) -> FloatArray:
    """Read every number once, on all cores: the limit."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.array(list(pool.map(np.max, np.array_split(points.ravel(), 2))))


def kernel_lines(count: int) -> Iterator[str]:
    """Yield the speeds of the median by cell."""
    rng = np.random.default_rng(1)
    half = KERNEL_SIDE / 2.0
    x, y = rng.uniform(-half, half, (2, count))
    z = np.sin(x / 40.0) + np.cos(y / 30.0) + 0.05 * rng.normal(size=count)
    points = np.stack([x, y, z], axis=1)
    ways: dict[str, Callable[..., FloatArray]] = {
        "spcola": by_spcola,
        "polars": by_polars,
        "scipy": by_scipy,
        "reading": reading,
    }
    seconds: dict[str, float] = {}
    medians: dict[str, FloatArray] = {}
    for name, way in ways.items():
        if name == "polars" and find_spec("polars") is None:
            yield "polars: not installed"
            continue
        for _ in range(1 if name == "scipy" else 3):
            start = time.perf_counter()
            medians[name] = way(points)
            taken = time.perf_counter() - start
            seconds[name] = min(seconds.get(name, np.inf), taken)
        yield f"{name:8} {seconds[name]:7.2f} s  {count / seconds[name] / 1e6:8.1f} M returns/s"
    for name in ("polars", "scipy"):
        if name in seconds:
            apart = float(np.nanmax(np.abs(medians[name] - medians["spcola"])))
            ratio = seconds[name] / seconds["spcola"]
            yield (
                f"{name} / spcola = {ratio:.1f} (bar {BARS[name]}); "
                f"medians differ by {apart:.0e} at most"
            )
    yield (
        f"spcola {count / seconds['spcola'] / 1e6:.0f} M returns/s (bar {BARS['kernel']:.0f}); "
        f"{seconds['spcola'] / seconds['reading']:.0f} times the limit"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="A mission's lidar: store, mapolas, kernel.")
    # The store first: the peak memory of a command is not below that of the process that starts it.
    parser.add_argument("--parts", nargs="+", default=["store", "kernel"],
                        choices=["store", "kernel"])  # fmt: skip
    parser.add_argument("--scans", type=int, default=64, help="of the mission's 640")
    parser.add_argument("--points", type=int, default=KERNEL_POINTS, help="of the median kernel")
    parser.add_argument("--work", type=Path, help="where files go; removed if not given")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = options.work or Path(folder)
        for part in options.parts:
            lines = (
                kernel_lines(options.points)
                if part == "kernel"
                else store_lines(root, options.scans)
            )
            for line in lines:
                print(line, flush=True)


if __name__ == "__main__":
    main()
