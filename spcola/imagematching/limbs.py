"""Limbs of a body in an image: places on its surface where lines of sight are tangent to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage, project_image, ray
from spcola.shape import Hits, RayCaster

__all__ = ["LimbPoints", "find_limb"]

# Pixels between the lines of sight at which the shape's silhouette is looked for, and halvings of
# such a distance: to a thirtieth of a pixel.
_LATTICE, _HALVINGS = 4, 7
# Steps of a profile across the limb, pixels; its length beyond the shape's error on either side;
# the length over which brightness is compared.
_STEP, _BEYOND, _OVER = 0.25, 4.0, 1.0
# Cosine of the incidence above which ground at the limb is lit.
_LIT = 0.3
# Brightness of the sky, and of the outermost ground, over that of the ground.
_SKY, _GROUND = 0.2, 0.3
# One standard deviation of a limb across itself, pixels.
_SIGMA_PX = 0.35


@dataclass(frozen=True, eq=False)
class LimbPoints:
    """N points of a body's surface on its limb in an image.

    Parameters
    ----------
    points : (N, 3) ndarray
        Body-fixed, metres.
    normals : (N, 3) ndarray
        Outward unit vectors across the limb and the line of sight, body-fixed.
    sigma : (N,) ndarray
        One standard deviation along the normals, metres, the image's state apart.
    """

    points: FloatArray
    normals: FloatArray
    sigma: FloatArray

    def __len__(self) -> int:
        return len(self.points)


def find_limb(image: SpcImage, shape: RayCaster, *, reach_m: float) -> LimbPoints:
    """Return the lit limb of a body in an image (Gaskell et al., §3.2).

    Where lines of sight begin to miss the shape, the brightness is followed from the sky to the
    ground. The limb is where it rises most steeply.

    Parameters
    ----------
    image : SpcImage
        With pixels and a state.
    shape : RayCaster
        In the frame of the image.
    reach_m : float
        How far the limb may lie from the shape's, metres.
    """
    hits, around = _silhouette(image, shape)
    sight = hits.points - image.position
    distance = np.linalg.norm(sight, axis=1)
    sight /= distance[:, None]
    across = hits.normals - np.sum(hits.normals * sight, axis=1)[:, None] * sight
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    pixel_m = image.pixel_angle * distance
    around &= across @ image.sun > _LIT
    points, across, pixel_m = hits.points[around], across[around], pixel_m[around]
    if not len(points):
        return LimbPoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    half = reach_m / float(pixel_m.min()) + _BEYOND
    steps = np.arange(-half, half + _STEP, _STEP)
    away = steps[:, None] * across[:, None, :] * pixel_m[:, None, None]
    brightness = _sampled(image, points[:, None, :] + away)
    place, found = _steepest(brightness)
    shift = (steps[0] + _STEP * place) * pixel_m
    moved = points + across * shift[:, None]
    return LimbPoints(moved[found], across[found], _SIGMA_PX * pixel_m[found])


def _silhouette(image: SpcImage, shape: RayCaster) -> tuple[Hits, BoolArray]:
    """Return where lines of sight just meet the shape, next to ones that miss it."""
    width, height = image.size
    places = np.meshgrid(
        np.arange(1.0, width + 1.0, _LATTICE), np.arange(1.0, height + 1.0, _LATTICE)
    )
    grid = np.stack(places, axis=-1)

    def cast(place: FloatArray) -> Hits:
        return shape.cast(image.position, ray(image, place[:, 0], place[:, 1]))

    met = cast(grid.reshape(-1, 2)).hit.reshape(grid.shape[:2])
    inside, outside = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for first, second in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        for one, other in ((first, second), (second, first)):
            edge = met[one] & ~met[other]
            inside.append(grid[one][edge])
            outside.append(grid[other][edge])
    near, far = np.concatenate(inside), np.concatenate(outside)
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        hit = cast(middle).hit[:, None]
        near, far = np.where(hit, middle, near), np.where(hit, far, middle)
    hits = cast(near)
    return hits, hits.hit


def _sampled(image: SpcImage, points: FloatArray) -> FloatArray:
    """Return the brightness at points (N, S, 3), bilinearly; NaN outside the frame."""
    assert image.pixels is not None
    pixel, line = project_image(image, points)
    known = np.isfinite(pixel + line)
    places = [np.where(known, place - 1.0, -1.0) for place in (line, pixel)]
    found: FloatArray = ndimage.map_coordinates(
        np.asarray(image.pixels, dtype=np.float64), places, order=1, cval=np.nan
    )
    return found


def _steepest(brightness: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return at which step (N,) profiles (N, S), from ground to sky, fall most steeply.

    The second array (N,) is where they have sky, ground, and an edge between them.
    """
    count, length = brightness.shape
    end = int(_BEYOND / (2.0 * _STEP))
    sky = np.median(brightness[:, -end:], axis=1)
    ground = np.quantile(brightness, 0.9, axis=1)
    found = np.isfinite(brightness).all(axis=1) & (sky < _SKY * ground)
    level = sky + _GROUND * (ground - sky)
    above = np.where(found[:, None], brightness, -np.inf) > level[:, None]
    outermost = length - 1 - np.argmax(above[:, ::-1], axis=1)
    over = int(_OVER / _STEP)
    fall = brightness[:, :-over] - brightness[:, over:]
    # Step of the middle of each fall; beyond a pixel from the outermost ground is other relief.
    middle = np.arange(fall.shape[1]) + over // 2
    near = np.abs(middle - outermost[:, None]) <= over
    best = np.argmax(np.where(near & found[:, None], fall, -np.inf), axis=1)
    found &= above.any(axis=1) & (best > 0) & (best < fall.shape[1] - 1)
    row, best = np.arange(count), np.clip(best, 1, fall.shape[1] - 2)
    before, top, after = (fall[row, best + k] for k in (-1, 0, 1))
    bend = before - 2.0 * top + after
    found &= bend < 0.0
    return middle[best] + 0.5 * (before - after) / np.where(found, bend, -1.0), found
