"""The Moon: crops of three frames of the Metric Camera of Apollo 15, under one Sun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import map_coordinates

from fusion.workspace import Workspace
from real.places import latitude_longitude
from real.printed import print_left_out
from real.run import Run, Solved, exposed
from real.steps import print_tiles
from spcola.arrays import FloatArray
from spcola.camera import SpcImage, project_image, ray
from spcola.formats.shapes import write_icq
from spcola.formats.solution import read_summary, write_summary
from spcola.grids import Maplet
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions

MOON = 1_737_400.0
# Sigmas of the states of Apollo's labels: the rays of three frames miss each other by 3 pixels.
MOON_SIGMA_M, MOON_SIGMA_PX = 300.0, 3.0


def moon(run: Run) -> None:
    """Two crops, and one that is left out."""
    print("Apollo 15, Metric Camera")
    cubes = sorted((run.data / "apollo15").glob("*.cub"))
    # Their stereo lies above the sphere: maplets begin where the frames agree.
    ball = run.work / "moon.txt"
    write_icq(ball, IcqShape(MOON * icq_directions(48)), digits=9)
    trial = run.work / "moon-trial"
    run.spcola("init", trial, "--body", "Moon", "--shape", ball, parallel=False)
    run.spcola("images", trial, *cubes, "--states", "label")
    images = exposed(Workspace.open(trial))
    radius = _agreed_radius(images)
    print(f"  the crops agree best on a sphere {radius - MOON:+.0f} m above {MOON:.0f} m")
    shape = run.work / "moon-agreed.txt"
    write_icq(shape, IcqShape(radius * icq_directions(48)), digits=9)
    root = run.work / "moon"
    run.spcola("init", root, "--body", "Moon", "--shape", shape, parallel=False)
    run.spcola("images", root, cubes[0], cubes[2], "--states", "label")
    workspace = Workspace.open(root)
    for image in workspace.images():
        path = workspace.image_path(image.name)
        stated = _with_sigmas(read_summary(path))
        path.unlink()
        write_summary(path, stated)
    caster = RayCaster(workspace.shape())
    middle = caster.cast(*_boresight(images[1])).points[0]
    latitude, longitude = latitude_longitude(middle)
    print_tiles(run.tile(root, 130, f"{latitude:.4f},{longitude:.4f},18000"))
    run.use(root, "tiles")
    solved = run.solve(root, "--shape-sigma", 1000)
    _print_slopes_by_sun(solved)
    print_left_out(run, "Moon", solved.photometry, solved, images[1:2])


def _print_slopes_by_sun(solved: Solved) -> None:
    """Print rms slopes along the Sun and across it: one Sun determines the first alone."""
    sun = np.mean([image.sun for image in solved.after.images()], axis=0)
    found = [_slopes_along(solved.after.maplet(name), sun) for name in solved.names]
    if found:
        along, across = np.sqrt(np.mean(np.square(found), axis=0))
        print(
            f"  rms slopes along the Sun {np.degrees(np.arctan(along)):.1f}°, across it "
            f"{np.degrees(np.arctan(across)):.1f}°, from a start without relief"
        )


def _slopes_along(maplet: Maplet, sun: FloatArray) -> tuple[float, float]:
    """Return the spread of the slopes of a maplet along the Sun and across it, rise over run."""
    way = (maplet.grid.axes @ sun)[:2]
    way /= np.linalg.norm(way)
    by_y, by_x = np.gradient(maplet.height, maplet.grid.gsd)
    along, across = way[0] * by_x + way[1] * by_y, way[0] * by_y - way[1] * by_x
    return float(np.nanstd(along)), float(np.nanstd(across))


def _boresight(image: SpcImage) -> tuple[FloatArray, FloatArray]:
    middle = (image.camera.width + 1) / 2.0, (image.camera.height + 1) / 2.0
    return image.position, ray(image, [middle[0]], [middle[1]])


def _with_sigmas(image: SpcImage) -> SpcImage:
    """Return an image with the sigmas of Apollo's labels."""
    angle = MOON_SIGMA_PX * image.camera.pixel_angle
    return replace(image, scobj_sigma=np.full(3, MOON_SIGMA_M), pointing_sigma=np.full(3, angle))


def _agreed_radius(images: Sequence[SpcImage]) -> float:
    """Return the radius of the sphere on which neighbouring frames look most alike."""
    start, way = _boresight(images[1])
    caster = RayCaster(IcqShape(MOON * icq_directions(48)).mesh())
    middle = caster.cast(start, way).points[0]
    up = middle / np.linalg.norm(middle)
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    steps = np.arange(-90, 91) * 130.0
    flat = steps[:, None, None] * np.cross(up, east) + steps[None, :, None] * east + middle
    ways = flat / np.linalg.norm(flat, axis=-1, keepdims=True)
    scores = {}
    for rise in np.arange(-8000.0, 12001.0, 250.0):
        seen = [_sampled(image, (MOON + rise) * ways) for image in images]
        scores[MOON + rise] = np.mean([_alike(a, b) for a, b in pairwise(seen)])
    return float(max(scores, key=scores.__getitem__))


def _sampled(image: SpcImage, points: FloatArray) -> FloatArray:
    assert image.pixels is not None
    pixel, line = project_image(image, points)
    return map_coordinates(
        np.asarray(image.pixels, dtype=np.float64), [line - 1.0, pixel - 1.0], order=1, cval=np.nan
    )


def _alike(one: FloatArray, other: FloatArray) -> float:
    both = np.isfinite(one) & np.isfinite(other)
    return float(np.corrcoef(one[both], other[both])[0, 1]) if np.count_nonzero(both) > 99 else -1.0
