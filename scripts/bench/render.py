"""Time the rendering of images of the truth body, compared with Embree, all in this run.

The image: a narrow camera of 1024² pixels at 3.8 km from a body of 245 m, all ground, at 45° of
incidence; one ray per pixel and one more to the Sun. Its first rendering makes the tiles, the
next uses them. The peer casts the same two rays per pixel on a mesh of the same spacing
(spcola.shape.rays, Embree), without brightness or noise. The limit is to fetch four float32 numbers
at each of the pixels' places and mix them, twice.

    python scripts/bench/render.py [--pixels 1024] [--spacing-m 0.05] [--repeats 3]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np

from spcola.camera import SpcImage, ray
from spcola.shape import Mesh, RayCaster
from spcola.truth.body import BodySettings, TruthBody
from spcola.truth.campaign.cameras import framing_camera, looking
from spcola.truth.imaging import render_image
from spcola.truth.imaging.rendering import Rendered
from spcola.truth.sampled import SampledSurface

DIRECTION = np.array([-0.8, -0.36, 0.48])
FAR = 3800.0
INCIDENCE = np.radians(45.0)


def station(pixels: int) -> SpcImage:
    """Return an image to be taken straight down."""
    direction = DIRECTION / np.linalg.norm(DIRECTION)
    across = np.cross(direction, [0.0, 0.0, 1.0])
    sun = np.cos(INCIDENCE) * direction + np.sin(INCIDENCE) * across / np.linalg.norm(across)
    position = FAR * direction
    camera, axes = framing_camera("PolyCam", pixels), looking(position, 200.0 * direction)
    return SpcImage("BENCH", "2019 JUL 01 00:00:00.000", camera, -position, axes, sun)


def patch_mesh(body: TruthBody, spacing: float, width: float) -> Mesh:
    """Return the ground under the camera, `width` metres across, as triangles."""
    count = int(width / spacing)
    axes = looking(FAR * DIRECTION, np.zeros(3))
    grid = (np.arange(count) - count / 2) * spacing
    y, x = np.meshgrid(grid, grid, indexing="ij")
    directions = 245.0 * DIRECTION + x[..., None] * axes[0] + y[..., None] * axes[1]
    directions = (
        directions.reshape(-1, 3) / np.linalg.norm(directions.reshape(-1, 3), axis=1)[:, None]
    )
    vertices = body.radius(directions)[:, None] * directions
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + count], axis=1)
    upper = np.stack([corner + 1, corner + count + 1, corner + count], axis=1)
    return Mesh(vertices, np.concatenate([lower, upper]))


def by_embree(caster: RayCaster, image: SpcImage) -> None:
    """Cast camera and Sun rays of the whole image."""
    lines, pixels = np.mgrid[1 : image.camera.height + 1, 1 : image.camera.width + 1]
    beams = ray(image, pixels.ravel().astype(float), lines.ravel().astype(float))
    hits = caster.cast(np.broadcast_to(image.position, beams.shape), beams)
    points = hits.points[np.isfinite(hits.distance)] + 1e-3 * image.sun
    caster.cast(points, np.broadcast_to(image.sun, points.shape))


def fetch(heights: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Interpolate from four neighbours at every pixel, twice: the least possible work."""
    rows, columns = (np.arange(size) % (len(heights) - 1) for size in shape)
    total = np.zeros(shape, dtype=np.float32)
    for _ in range(2):
        for down in (0, 1):
            for right in (0, 1):
                total += np.float32(0.25) * heights[np.ix_(rows + down, columns + right)]
    return total


def seconds_of(work: Callable[[], object]) -> tuple[float, float]:
    """Return wall and CPU time of `work`, seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def report(name: str, seconds: tuple[float, float], pixels: int) -> None:
    wall, cpu = seconds
    per_pixel = 1e9 / pixels
    print(f"{name:<42}{wall:>9.3f}{cpu:>9.3f}{wall / pixels * 1e6:>12.3f}{cpu * per_pixel:>15.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the rendering of truth images.")
    parser.add_argument("--pixels", type=int, default=1024)
    parser.add_argument("--spacing-m", type=float, default=0.05)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    body, image = TruthBody(BodySettings(radius=245.0)), station(options.pixels)
    sphere = TruthBody(BodySettings.sphere(245.0))
    small = SampledSurface(sphere, 5.0)

    def rendered(surface: SampledSurface, of: TruthBody, at: SpcImage) -> Rendered:
        return render_image(surface, of, at, generator=np.random.default_rng(0))

    rendered(small, sphere, station(32))  # compiles
    body.radius(np.eye(3))
    body.albedo(np.eye(3))
    count = image.camera.width * image.camera.height
    print(f"{options.pixels}² pixels, {options.spacing_m} m spacing, {os.cpu_count()} cores")
    head = f"{'':<42}{'wall s':>9}{'CPU s':>9}{'s per 1e6':>12}{'CPU ns/pixel':>15}"
    print(head)
    surfaces: list[SampledSurface] = []
    start = seconds_of(lambda: surfaces.append(SampledSurface(body, options.spacing_m)))
    report("surface (bounds of all tiles)", start, count)
    surface = surfaces[0]
    first = seconds_of(lambda: rendered(surface, body, image))
    report(f"first image ({surface.tiles_made} tiles made)", first, count)
    runs = [seconds_of(lambda: rendered(surface, body, image)) for _ in range(options.repeats)]
    report("next image (best)", min(runs), count)
    meshes: list[RayCaster] = []
    width = 1.15 * options.pixels * image.camera.pixel_angle * (FAR - 200.0)
    made = seconds_of(lambda: meshes.append(RayCaster(patch_mesh(body, options.spacing_m, width))))
    report("Embree: mesh and tree", made, count)
    runs = [seconds_of(lambda: by_embree(meshes[0], image)) for _ in range(options.repeats)]
    report("Embree: rays alone (best)", min(runs), count)
    heights = np.random.default_rng(0).random((1025, 1025), dtype=np.float32)
    shape = (image.camera.height, image.camera.width)
    runs = [seconds_of(lambda: fetch(heights, shape)) for _ in range(options.repeats)]
    report("limit: fetch and mix (one core, best)", min(runs), count)


if __name__ == "__main__":
    main()
