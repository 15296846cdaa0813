"""The images that show a maplet, and the accuracy of slopes from them."""

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
# The maplets are assumed to be made from the images at hand if half of them lie in this many or
# more: fewer images determine no slope.
_ENOUGH = 3
# Number of images that represent a campaign's illumination if its own images are not at hand.
_MOST_SAMPLES = 48


@dataclass(frozen=True, eq=False)
class ImageSlopes:
    """The images of a solution, as a source of slopes.

    Parameters
    ----------
    images : tuple of SpcImage
        States, without pixels.
    light : {"images", "sun"}
        "images": a point has to lie on the detector of an image. "sun": all images taken from above
        its horizon count, for maplets made from more images than are at hand.
    exposed : callable
        Returns an image with its pixels, if it has any.
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
    ) -> ImageSlopes:
        """Choose `light`: "images" if half of the `grids` lie in three images, else "sun".

        Parameters
        ----------
        images : tuple of SpcImage
        grids : list of MapletGrid
        exposed : callable, optional
            Image → image with its pixels.
        """
        framed = cls(images, "images", exposed)
        shown = [len(list(framed.facing(grid))) for grid in grids]
        enough = bool(shown) and float(np.median(shown)) >= _ENOUGH
        return framed if enough else cls(images, "sun", exposed)

    def facing(self, grid: MapletGrid) -> Iterator[SpcImage]:
        """Yield the images that may show a grid: from above its plane, if framed pointing at it."""
        away = self._positions - grid.center
        distance = np.linalg.norm(away, axis=1)
        faces = away @ grid.uz > 0.0
        if self.light == "images":
            # Half field of view plus the angular radius of the grid.
            width = self._half_widths + np.arctan2(grid.radius, distance)
            faces &= np.sum(self._boresights * -away, axis=1) > np.cos(width) * distance
        found = np.flatnonzero(faces)
        if self.light == "sun":
            found = found[:: max(1, -(-len(found) // _MOST_SAMPLES))]
        return (self.images[number] for number in found)

    def variance(self, maplet: Maplet) -> SlopeVariance:
        """Return the variance of the slopes of `maplet` from the images."""
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
        """Angle, radians, of the detector's diagonal: reaches every corner from any boresight."""
        return np.array(
            [
                np.hypot(image.camera.width, image.camera.height) * image.camera.pixel_angle
                for image in self.images
            ]
        )
