"""Which images lit a maplet, and what they tell of its slopes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.photometry import SlopeVariance, slope_variance

Light = Literal["images", "sun"]
# Images in which half of the maplets have to lie, for these to be what the maplets were made from:
# fewer determine no slope.
_ENOUGH = 3
# Images that stand for all others of a campaign in whose light a maplet may have been seen.
_STAND_INS = 48


@dataclass(frozen=True, eq=False)
class Illumination:
    """The images of a solution, as a source of slopes.

    Parameters
    ----------
    images : tuple of SpcImage
        States, without pixels.
    light : {"images", "sun"}
        Whether a point has to lie on the detector of an image, or only in such light as the
        images that stood above it were taken in: the latter where the maplets come from more
        images than are at hand.
    exposed : callable
        Returns an image with its pixels, where it has any.
    """

    images: tuple[SpcImage, ...]
    light: Light
    exposed: Callable[[SpcImage], SpcImage] = lambda image: image

    @classmethod
    def of(
        cls,
        images: tuple[SpcImage, ...],
        grids: list[MapletGrid],
        exposed: Callable[[SpcImage], SpcImage] = lambda image: image,
    ) -> Illumination:
        """Return `images` as what maplets on `grids` come from, if half of these lie in three."""
        framed = cls(images, "images", exposed)
        shown = [len(list(framed.facing(grid))) for grid in grids]
        enough = bool(shown) and float(np.median(shown)) >= _ENOUGH
        return framed if enough else cls(images, "sun", exposed)

    def facing(self, grid: MapletGrid) -> Iterator[SpcImage]:
        """Yield the images that may show a grid: above its plane and, of images, towards it."""
        away = self._positions - grid.center
        distance = np.linalg.norm(away, axis=1)
        faces = away @ grid.uz > 0.0
        if self.light == "images":
            # The grid reaches so far around its centre as seen from there.
            width = self._half_widths + np.arctan2(grid.radius, distance)
            faces &= np.sum(self._boresights * -away, axis=1) > np.cos(width) * distance
        found = np.flatnonzero(faces)
        if self.light == "sun":
            found = found[:: max(1, -(-len(found) // _STAND_INS))]
        return (self.images[number] for number in found)

    def variance(self, maplet: Maplet) -> SlopeVariance:
        """Return how well the images tell the slopes of `maplet`."""
        framed = self.light == "images"
        images = (self.exposed(image) if framed else image for image in self.facing(maplet.grid))
        return slope_variance(maplet, images, framed=framed)

    @cached_property
    def _positions(self) -> FloatArray:
        return np.array([image.position for image in self.images]).reshape(-1, 3)

    @cached_property
    def _boresights(self) -> FloatArray:
        return np.array([image.boresight for image in self.images]).reshape(-1, 3)

    @cached_property
    def _half_widths(self) -> FloatArray:
        """Angle, radians, that reaches the furthest corner, wherever the boresight meets it."""
        return np.array(
            [
                np.hypot(image.camera.width, image.camera.height) * image.camera.pixel_angle
                for image in self.images
            ]
        )
