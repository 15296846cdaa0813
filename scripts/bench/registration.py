#!/usr/bin/env python3
"""Registration compared with its theoretical limit and its peer, all measured in this run.

Two clouds of a million points each lie on a fractal square of 100 m with slopes of 0.2 (rms, of
one power in every octave down to 11 cm), with 30 mm of noise; one is moved by 50 mm, 0.002° and
−500 ppm. Printed: errors of the similarity found, its stated sigmas and the formal limit of the
data (Cramér–Rao, from the true slopes and both clouds' noise and numbers), the same for Open3D's
ICP with scaling, root mean squares over seeds, the effect of smoothing one cloud on the scale, a
scan of a million returns against an SPC surface, and the number of mapolas matched per second.

    python scripts/bench/registration.py [--seeds 8] [--parts clouds icp blur returns match]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

import numpy as np
from scipy import ndimage

from fusion.registration.clouds.clouds import CloudOptions, register_clouds
from fusion.registration.returns import CloudOfReturns, FixedSurface, match_returns
from fusion.runtime import ThreadExecutor
from fusion.surfacematch import Match, Surface, match_surfaces
from fusion.surfacematch.resolution import NoiseSpectrum, estimate_spectrum
from fusion.surfacematch.resolution import blur as blurred
from spcola.arrays import AnyArray, FloatArray
from spcola.grids import MapletGrid
from spcola.math import Affine, Similarity

SIDE_M, NODES, SLOPE, NOISE_M = 100.0, 1024, 0.2, 0.03
STEP_M = 1.1 * SIDE_M / NODES
CELL_M = 0.1
PLANTED = Similarity.from_rotation_vector(
    np.radians(0.002) * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0),
    0.05 * np.array([1.0, 1.0, -1.0]) / np.sqrt(3.0),
    1.0 - 500e-6,
)
BARS = {"limit": 1.5, "icp": 20.0, "match": 200.0}
THREADS, MAPOLAS, CASES = 2, 400, 24


@dataclass(frozen=True)
class Ground:
    """Fractal heights by their spectrum."""

    spectrum: AnyArray
    wave: FloatArray

    @classmethod
    def of(cls, seed: int) -> Ground:
        wave = 2.0 * np.pi * np.fft.fftfreq(NODES, STEP_M)
        length = np.hypot(wave[None], wave[:, None])
        length[0, 0] = np.inf
        white = np.random.default_rng(seed).normal(size=(NODES, NODES))
        ground = cls(np.fft.fft2(white) * length**-2.0, wave)
        slopes = [layer.std() for layer in ground.slope_layers()]
        return cls(ground.spectrum * SLOPE / np.hypot(*slopes), wave)

    def slope_layers(self) -> list[FloatArray]:
        along, down = 1j * self.wave[None], 1j * self.wave[:, None]
        return [np.fft.ifft2(each * self.spectrum).real for each in (along, down)]

    def heights(self, x: FloatArray, y: FloatArray, blur_m: float = 0.0) -> FloatArray:
        square = self.wave[None] ** 2 + self.wave[:, None] ** 2
        return at(np.fft.ifft2(self.spectrum * np.exp(-0.5 * blur_m**2 * square)).real, x, y)

    def cloud(self, seed: int, count: int, blur_m: float = 0.0) -> FloatArray:
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(-SIDE_M / 2, SIDE_M / 2, (2, count))
        height = self.heights(x, y, blur_m) + NOISE_M * rng.normal(size=count)
        return np.stack([x, y, height], axis=1)

    def limit(self, cloud: FloatArray) -> FloatArray:
        """Return the smallest sigmas (7,) of an unbiased estimate from two such clouds."""
        slopes = [at(layer, cloud[:, 0], cloud[:, 1]) for layer in self.slope_layers()]
        up = np.stack([-slopes[0], -slopes[1], np.ones(len(cloud))], axis=1)
        along = np.sum(cloud * up, axis=1)[:, None]
        rows = np.concatenate([up, np.cross(cloud, up), along], axis=1)
        return np.sqrt(2.0 * NOISE_M**2 * np.diag(np.linalg.inv(rows.T @ rows)))


def at(layer: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    places = [y / STEP_M + NODES / 2, x / STEP_M + NODES / 2]
    found: FloatArray = ndimage.map_coordinates(layer, places, order=3, mode="grid-wrap")
    return found


def errors(found: Similarity) -> FloatArray:
    """Return translation, rotation and scale (7,) minus the planted ones."""
    turn = Similarity(found.rotation @ PLANTED.rotation.T).rotation_vector
    shift = found.translation - PLANTED.translation
    return np.array([*shift, *turn, found.scale - PLANTED.scale])


def numbers(seven: FloatArray) -> str:
    """Return the norms of translation and rotation, and the scale: mm, degrees, ppm."""
    shift, turn = np.linalg.norm(seven[:3]), np.degrees(np.linalg.norm(seven[3:6]))
    return f"{1e3 * shift:9.3f} mm {turn:10.5f}° {1e6 * abs(seven[6]):9.1f} ppm"


@dataclass(frozen=True)
class Found:
    """Result of one run."""

    seconds: float
    error: FloatArray
    sigma: FloatArray
    limit: FloatArray


def ours(seed: int, count: int) -> Found:
    ground = Ground.of(seed)
    cloud = ground.cloud(1000 + seed, count)
    moving, fixed = PLANTED.inverse().apply(cloud), ground.cloud(2000 + seed, count)
    start = time.perf_counter()
    found = register_clouds(moving, fixed)
    seconds = time.perf_counter() - start
    sigma = np.sqrt(np.diag(found.covariance))
    return Found(seconds, errors(found.similarity), sigma, ground.limit(cloud))


def cloud_lines(seeds: int, count: int) -> Iterator[str]:
    ours(99, min(count, 50_000))  # compiles, or loads what was
    runs = [ours(seed, count) for seed in range(seeds)]
    for seed, run in enumerate(runs):
        yield f"seed {seed:<2} {run.seconds:6.2f} s {numbers(run.error)}"
    rms = [np.sqrt(np.mean(np.square(each), axis=0)) for each in (
        [run.error for run in runs], [run.sigma for run in runs], [run.limit for run in runs],
        [run.error / run.sigma for run in runs],
    )]  # fmt: skip
    for name, seven in zip(("rms error", "stated", "limit"), rms[:3], strict=True):
        yield f"{name:17}{numbers(seven)}"
    groups = {"translation": slice(3), "rotation": slice(3, 6), "scale": slice(6, 7)}
    for name, part in groups.items():
        ratio = np.linalg.norm(rms[0][part]) / np.linalg.norm(rms[2][part])
        pull = np.sqrt(np.mean(rms[3][part] ** 2))
        yield f"{name}: {ratio:.2f} × the limit (bar {BARS['limit']}); pulls {pull:.2f} wide"
    ratio = float(np.sqrt(np.mean((rms[0] / rms[2]) ** 2)))
    yield f"all seven together: {ratio:.2f} × the limit"


def icp_lines(count: int) -> Iterator[str]:
    if find_spec("open3d") is None:
        yield "Open3D: not installed"
        return
    run = ours(0, count)
    o3d = import_module("open3d")
    ground = Ground.of(0)
    moving = PLANTED.inverse().apply(ground.cloud(1000, count))
    clouds = [
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        for points in (moving, ground.cloud(2000, count))
    ]
    way = o3d.pipelines.registration
    start = time.perf_counter()
    result = way.registration_icp(
        *clouds,
        0.3,
        np.eye(4),
        way.TransformationEstimationPointToPoint(with_scaling=True),
        way.ICPConvergenceCriteria(max_iteration=100),
    )
    seconds = time.perf_counter() - start
    matrix = np.asarray(result.transformation)
    found = Affine(matrix[:3, :3], matrix[:3, 3]).nearest_similarity()
    yield f"{'ours':8}{run.seconds:8.2f} s {numbers(run.error)}"
    yield f"{'Open3D':8}{seconds:8.2f} s {numbers(errors(found))}"
    yield f"Open3D / ours = {seconds / run.seconds:.0f} (bar {BARS['icp']:.0f})"


def blur_lines(seeds: int, count: int) -> Iterator[str]:
    yield "fixed cloud smoothed by       as it is      both at one resolution   stated sigma"
    plain = [scale_error(seed, count, 0.0, None)[0] for seed in range(seeds)]
    for cells in (1.0, 2.0):
        columns = []
        for blur in (0.0, None):
            found = [scale_error(seed, count, cells * CELL_M, blur) for seed in range(seeds)]
            change = [one[0] - other for one, other in zip(found, plain, strict=True)]
            columns.append((np.mean(change), np.mean([one[1] for one in found])))
        yield (
            f"{cells:.0f} cells of {CELL_M} m{columns[0][0] * 1e6:18.0f} ppm"
            f"{columns[1][0] * 1e6:18.0f} ppm{columns[1][1] * 1e6:15.0f} ppm"
        )


def scale_error(seed: int, count: int, blur_m: float, blur: float | None) -> tuple[float, float]:
    """Return the error of the scale, and its stated sigma."""
    ground = Ground.of(seed)
    moving = PLANTED.inverse().apply(ground.cloud(1000 + seed, count))
    fixed = ground.cloud(2000 + seed, count, blur_m)
    found = register_clouds(moving, fixed, options=CloudOptions(blur_cells=blur))
    return float(errors(found.similarity)[6]), float(np.sqrt(found.covariance[6, 6]))


def spc_heights(ground: Ground, grid: MapletGrid, seed: int) -> FloatArray:
    """Return a surface as of SPC: smoothed by a cell, with correlated errors of 5 cm."""
    x, y = np.meshgrid(grid.gsd * grid.offsets, grid.gsd * grid.offsets)
    error = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=grid.shape), 3.0)
    return ground.heights(x, y, grid.gsd) + 0.05 * error / error.std()


def returns_lines(count: int) -> Iterator[str]:
    grid = MapletGrid(np.zeros(3), np.eye(3), 0.2, 240)
    ground = Ground.of(5)
    planted = np.array([0.3, -0.2, 0.1])
    cloud = ground.cloud(3000, count) - planted
    returns = CloudOfReturns(cloud, np.full(count, NOISE_M))
    fixed = FixedSurface(grid, Surface(spc_heights(ground, grid, 0)), 1.0)
    for number in range(2):
        start = time.perf_counter()
        found = match_returns("M", returns, fixed)
        seconds = time.perf_counter() - start
        if number:
            yield f"{count} returns to an SPC surface of {grid.size}²: {seconds:.2f} s"
    stated = np.sqrt(np.diag(found.covariance))
    for name, three in (("error", found.local - planted), ("stated", stated)):
        yield f"{name:17}" + "".join(f"{1e3 * axis:9.3f} mm" for axis in three)


def match_lines() -> Iterator[str]:
    """Match mapolas of 99² with blurred maplets, with errors of 10 cm over five cells."""
    grid = MapletGrid(np.zeros(3), np.eye(3), 0.35, 49)
    cases = [match_case(seed, grid) for seed in range(CASES)]
    executor = ThreadExecutor(THREADS)

    def matched(blur_cells: float, spectrum: NoiseSpectrum | None) -> tuple[float, list[Match]]:
        def one(number: int) -> Match:
            lidar, spc = cases[number % CASES]
            return match_surfaces("M", grid, lidar, spc, blur_cells=blur_cells, spectrum=spectrum)

        list(executor.stream(one, range(4)))
        start = time.perf_counter()
        found = list(executor.stream(one, range(MAPOLAS)))
        return MAPOLAS / (time.perf_counter() - start), found

    rate, plain = matched(1.2, None)
    yield match_line("all wavelengths alike", rate, plain)
    spectrum = estimate_spectrum(match.residual for match in plain[:CASES])
    yield match_line("by their likelihood", *matched(1.2, spectrum))


def match_case(seed: int, grid: MapletGrid) -> tuple[Surface, Surface]:
    """Return a lidar surface, and an SPC surface displaced by 10, −7 and 0 cm; 2 % are missing."""
    x, y = np.meshgrid(grid.gsd * grid.offsets, grid.gsd * grid.offsets)
    rng, ground = np.random.default_rng(seed), Ground.of(6 + seed)
    lidar = ground.heights(x, y) + 0.01 * rng.normal(size=grid.shape)
    lidar[rng.random(grid.shape) < 0.02] = np.nan
    noise = ndimage.gaussian_filter(rng.normal(size=grid.shape), 2.5, mode="wrap")
    spc = blurred(ground.heights(x - 0.1, y + 0.07), 1.2) + 0.1 * noise / noise.std()
    one, two = (np.full(grid.shape, sigma) for sigma in (0.01, 0.1))
    return Surface(lidar, one), Surface(spc, two)


def match_line(name: str, rate: float, found: list[Match]) -> str:
    errors = np.array([match.local - [0.1, -0.07, 0.0] for match in found if match.usable])
    across, up = (1e3 * np.sqrt(np.mean(each**2)) for each in (errors[:, :2], errors[:, 2]))
    return (
        f"{name:24}{rate:5.0f} mapolas of 99² a second on {THREADS} threads "
        f"(bar {BARS['match']:.0f}); {len(errors) / len(found):.0%} usable, off by {across:.1f} mm "
        f"along the ground, {up:.1f} up"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Registration, its limits and its peer.")
    parts = ("clouds", "icp", "blur", "returns", "match")
    parser.add_argument("--parts", nargs="+", default=list(parts), choices=parts)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--points", type=int, default=1_000_000, help="of each cloud")
    options = parser.parse_args()
    ways = {
        "clouds": lambda: cloud_lines(options.seeds, options.points),
        "icp": lambda: icp_lines(options.points),
        "blur": lambda: blur_lines(min(options.seeds, 3), options.points),
        "returns": lambda: returns_lines(options.points),
        "match": match_lines,
    }
    for part in options.parts:
        print(f"— {part}")
        for line in ways[part]():
            print(line, flush=True)


if __name__ == "__main__":
    main()
