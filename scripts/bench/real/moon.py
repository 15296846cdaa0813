"""Frames of Apollo: states with sigmas, and the sphere on which they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import map_coordinates

from spcola.camera import SpcImage, project_image, ray
from spcola.shape import RayCaster
from spcola.shape.icq import IcqShape, icq_directions

MOON = 1_737_400.0
# Sigmas of the states of Apollo's labels: the rays of three frames miss each other by 3 pixels.
_SIGMA_M, _SIGMA_PX = 300.0, 3.0


def boresight(image: SpcImage) -> tuple[np.ndarray, np.ndarray]:
    """Return where an image was taken from (m), and the direction of its middle."""
    middle = (image.camera.width + 1) / 2.0, (image.camera.height + 1) / 2.0
    return image.position, ray(image, [middle[0]], [middle[1]])


def with_sigmas(image: SpcImage) -> SpcImage:
    """Return an image with the sigmas of Apollo's labels."""
    angle = _SIGMA_PX * image.camera.pixel_angle
    return replace(image, scobj_sigma=np.full(3, _SIGMA_M), pointing_sigma=np.full(3, angle))


def agreed_radius(images: Sequence[SpcImage]) -> float:
    """Return the radius of the sphere on which neighbouring frames look most alike."""
    start, way = boresight(images[1])
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


def _sampled(image: SpcImage, points: np.ndarray) -> np.ndarray:
    assert image.pixels is not None
    pixel, line = project_image(image, points)
    return map_coordinates(
        np.asarray(image.pixels, dtype=np.float64), [line - 1.0, pixel - 1.0], order=1, cval=np.nan
    )


def _alike(one: np.ndarray, other: np.ndarray) -> float:
    both = np.isfinite(one) & np.isfinite(other)
    return float(np.corrcoef(one[both], other[both])[0, 1]) if np.count_nonzero(both) > 99 else -1.0
