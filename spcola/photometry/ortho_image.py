"""Ortho-rectification: an image resampled to the points of a grid, with its illumination."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera import SpcImage, partials_position, project_image
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.photometry.ground import Facets, Ground
from spcola.photometry.shadows import cast_shadow, hidden
from spcola.shape import RayCaster

# Distance of a ray from its own grid before other ground may occlude it, GSDs.
_CLEAR = 2.0
# Ground of the body over the grid is other ground from this height on, in radii of the grid.
_ABOVE = 0.5
# Most samples across a cell: a pixel sixteen times smaller than a cell.
_MOST_SAMPLES = 16
# Margin of the window of pixels, against effects of the spline at its edge.
_MARGIN = 8


@dataclass(frozen=True, eq=False)
class View:
    """Geometry of ground in an image: places, visibility and illumination.

    Attributes
    ----------
    image : str
        Name.
    pixel, line : (R, C) ndarrays
        Where each point of the grid is projected; NaN at unknown heights.
    seen : (R, C) ndarray of bool
        Whether a point is in the frame, faces the camera and is not occluded.
    lit : (R, C) ndarray of bool
        Whether it faces the Sun and is in no cast shadow.
    cos_incidence, cos_emission : (R − 1, C − 1) ndarrays
        Of the angles between the normal of each cell and Sun, camera; NaN where it has no slope.
    phase : (R − 1, C − 1) ndarray
        Angle between Sun and camera, radians.
    footprint : (2, 2) ndarray
        ∂(pixel, line)/∂(x, y) on the grid's plane at its centre, pixels a grid step.
    """

    image: str
    pixel: FloatArray
    line: FloatArray
    seen: BoolArray
    lit: BoolArray
    cos_incidence: FloatArray
    cos_emission: FloatArray
    phase: FloatArray
    footprint: FloatArray


@dataclass(frozen=True, eq=False)
class OrthoImage:
    """An image resampled to a grid.

    Attributes
    ----------
    view : View
    brightness : (R, C) ndarray
        Mean over each cell where pixels are smaller than cells, interpolated where they are
        larger; in the image's numbers. NaN where the image does not show the ground.
    exposed : (R, C) ndarray of bool
        Whether brightness is between the image's thresholds: neither shadow nor saturated.
    saturated : (R, C) ndarray of bool
    """

    view: View
    brightness: FloatArray
    exposed: BoolArray
    saturated: BoolArray


def view_of(
    image: SpcImage, grid: MapletGrid, height: FloatArray, *, beyond: RayCaster | None = None
) -> View:
    """Return the geometry of ground in an image.

    Occlusion and shadow by the ground itself follow the ray over its bilinear heights; those by
    other ground follow the rays cast at `beyond`. A ray that leaves the grid inside that body,
    whose surface may be coarser, is not occluded there. Over the grid only ground counts that is
    higher than its own by half of its radius: what hangs over it.

    Parameters
    ----------
    image : SpcImage
        State; pixels are not needed.
    grid : MapletGrid
        In the frame of the image.
    height : (R, C) ndarray
        Metres along the grid's Uz; NaN where unknown.
    beyond : RayCaster, optional
        The whole body.

    Raises
    ------
    InvalidValueError
        If the grid's centre is behind the camera.
    """
    ground = Ground.of(grid, np.asarray(height, dtype=np.float64))
    footprint = footprint_of(image, grid)
    sun, eye = ground.sun(image), ground.eye(image)
    incidence, emission = ground.cosine(sun), ground.cosine(eye)
    pixel, line = project_image(image, ground.points)
    camera = image.camera
    with np.errstate(invalid="ignore"):
        seen: BoolArray = (pixel >= 0.5) & (pixel < camera.width + 0.5) & (emission > 0.0)
        seen &= (line >= 0.5) & (line < camera.height + 0.5)
        lit: BoolArray = incidence > 0.0
    step = [1.0, 1.0, grid.gsd]
    first = np.array([grid.half_size, grid.half_size, 0.0])
    place = first + grid.axes @ (image.position - grid.center) / [grid.gsd, grid.gsd, 1.0]
    if seen.any():
        seen &= ~hidden(ground.height, place)
        lit &= ~cast_shadow(ground.height, sun * step)
    if beyond is not None:
        stop_at_other_ground(seen, beyond, ground, eye)
        stop_at_other_ground(lit, beyond, ground, np.broadcast_to(sun, eye.shape))
    cells = Facets.of(ground)
    toward = cells.eye(image)
    phase = np.arccos(np.clip(toward @ sun, -1.0, 1.0))
    cosines = cells.cosine(sun), cells.cosine(toward)
    return View(image.name, pixel, line, seen, lit, *cosines, phase, footprint)


def footprint_of(image: SpcImage, grid: MapletGrid) -> FloatArray:
    """Return ∂(pixel, line)/∂(x, y) (2, 2) on the plane of a grid, pixels a grid step.

    Raises
    ------
    InvalidValueError
        If its centre is behind the camera.
    """
    partials = partials_position(image, grid.center)
    footprint: FloatArray = grid.gsd * partials @ grid.axes[:2].T
    if not np.isfinite(footprint).all():
        raise InvalidValueError("lies behind the camera", f"grid in {image.name}")
    return footprint


def stop_at_other_ground(
    reached: BoolArray,
    beyond: RayCaster,
    ground: Ground,
    direction: FloatArray,
    square: MapletGrid | None = None,
) -> None:
    """Clear `reached` (R, C) where other ground occludes the directions (R, C, 3).

    Other ground is what lies beyond the border of `square`: that of the ground if not given, or the
    grid of the same place of which this one is a coarse copy.
    """
    chosen = np.nonzero(reached)
    if not chosen[0].size:
        return
    grid, along = ground.grid, direction[chosen]
    square = square or grid
    places = grid.gsd * np.stack([grid.offsets[chosen[1]], grid.offsets[chosen[0]]], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Distance to the border of the square in the ray's direction, metres along the ray; NaN
        # along a border that it follows.
        border = (np.sign(along[:, :2]) * square.half_size * square.gsd - places) / along[:, :2]
    way = np.fmin.reduce(np.maximum(border, 0.0), axis=1) + _CLEAR * square.gsd
    # A ray that is over its grid until it is above the whole body meets nothing beyond its border.
    way = np.where(np.isfinite(way), np.minimum(way, 2.0 * beyond.radius), 2.0 * beyond.radius)
    points, beams = ground.points[chosen], along @ grid.axes
    first = np.minimum(way, _ABOVE * grid.radius)
    distance, outside = _met(beyond, points, beams, first)
    stopped = outside & (distance >= way)
    over = np.flatnonzero(distance < way)
    if over.size:
        # Over the grid the body is the same ground, or other ground that hangs over it.
        met = points[over] + distance[over, None] * beams[over]
        other = outside[over] & (_height_above(ground, met) > _ABOVE * grid.radius)
        stopped[over[other]] = True
        own = over[~other]
        stopped[own] = _met(beyond, points[own], beams[own], way[own])[1]
    reached[chosen[0][stopped], chosen[1][stopped]] = False


def _met(
    beyond: RayCaster, points: FloatArray, beams: FloatArray, start: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return how far along rays (N, 3) from points a body is met, and whether from outside.

    What is nearer than `start` (N,), metres, is passed; infinity where nothing is met.
    """
    hits = beyond.cast(points + start[:, None] * beams, beams)
    outside = hits.hit & (np.sum(hits.normals * beams, axis=1) < 0.0)
    return np.where(hits.hit, start + hits.distance, np.inf), outside


def _height_above(ground: Ground, points: FloatArray) -> FloatArray:
    """Return how far points (N, 3) over a grid lie above its ground, metres; 0 where unknown."""
    grid = ground.grid
    local = (points - grid.center) @ grid.axes.T
    column, row = (
        np.clip(np.rint(local[:, k] / grid.gsd).astype(np.int64) + grid.half_size, 0, grid.size - 1)
        for k in (0, 1)
    )
    return np.nan_to_num(local[:, 2] - ground.height[row, column])


def ortho_rectify(image: SpcImage, view: View) -> OrthoImage:
    """Return an `image` with pixels, resampled to the grid of its `view`.

    Raises
    ------
    InvalidValueError
        If the image has no pixels.
    """
    if image.pixels is None:
        raise InvalidValueError("has no pixels", image.name, "put its .DAT into IMAGEFILES")
    shape = view.pixel.shape
    brightness, nearest = np.full(shape, np.nan), np.zeros(shape)
    if view.seen.any():
        place = np.stack([view.line[view.seen], view.pixel[view.seen]]) - 1.0
        rows, columns = np.rint(place).astype(np.int64)
        nearest[view.seen] = image.pixels[rows, columns]
        brightness[view.seen] = resampled(image.pixels, place, view.footprint)
    low, high = image.thresholds
    exposed = view.seen & (nearest > low) & (nearest < high)
    return OrthoImage(view, brightness, exposed, view.seen & (nearest >= high))


def resampled(pixels: AnyArray, place: FloatArray, footprint: FloatArray) -> FloatArray:
    """Return the brightness (N,) of cells at the `place` (2, N) of each in `pixels`.

    Cells that are larger than pixels are means of samples a pixel apart; else a cubic spline.
    Places are rows and columns from 0; `footprint` is that of a :class:`View`.
    """
    low = np.maximum(np.floor(place.min(axis=1)).astype(int) - _MARGIN, 0)
    high = np.ceil(place.max(axis=1)).astype(int) + _MARGIN + 1
    window = pixels[low[0] : high[0], low[1] : high[1]].astype(np.float64)
    local = place - low[:, None]
    # Longest extent of a cell in the image, pixels.
    count = min(int(np.ceil(np.linalg.norm(footprint, ord=2))), _MOST_SAMPLES)
    if count <= 1:
        return np.asarray(ndimage.map_coordinates(window, local, order=3, mode="nearest"))
    total = np.zeros(place.shape[1])
    steps = (np.arange(count) + 0.5) / count - 0.5
    for x in steps:
        for y in steps:
            aside, down = footprint @ [x, y]
            there = local + np.array([[down], [aside]])
            total += ndimage.map_coordinates(window, there, order=1, mode="nearest")
    return total / count**2
