"""Heights on a grid as light and cameras meet them: slopes, and cosines with directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.heights.slopes import slopes_of
from spcola.image import SpcImage
from spcola.maplet import MapletGrid, check_layer


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of a grid; directions are along its own Ux, Uy, Uz.

    Parameters
    ----------
    grid : MapletGrid
    height : (R, C) ndarray
        Metres along Uz; NaN where unknown.
    points : (R, C, 3) ndarray
        Body-fixed, metres.
    slope_x, slope_y : (R, C) ndarrays
        ∂h/∂x and ∂h/∂y.
    """

    grid: MapletGrid
    height: FloatArray
    points: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray

    @classmethod
    def of(cls, grid: MapletGrid, height: FloatArray) -> Ground:
        """Return the ground of heights (R, C), metres, on `grid`."""
        check_layer(height, grid, "height")
        return cls(grid, height, grid.points(height), *slopes_of(height, grid.gsd))

    def pixel(self, image: SpcImage) -> float:
        """Width of a pixel on the ground that the camera looks straight at, grid steps."""
        away = float(np.linalg.norm(image.position - self.grid.center))
        return image.camera.pixel_angle * away / self.grid.gsd

    def sun(self, image: SpcImage) -> FloatArray:
        """Direction of the Sun (3,)."""
        direction: FloatArray = self.grid.axes @ image.sun
        return direction

    def eye(self, image: SpcImage) -> FloatArray:
        """Unit vectors (R, C, 3) to the camera."""
        away = (image.position - self.points) @ self.grid.axes.T
        unit: FloatArray = away / np.linalg.norm(away, axis=-1, keepdims=True)
        return unit

    def cosine(self, direction: FloatArray) -> FloatArray:
        """Cosine (R, C) between the normals and a direction (…, 3) [19]."""
        steep = np.sqrt(1.0 + self.slope_x**2 + self.slope_y**2)
        along: FloatArray = (
            direction[..., 2] - self.slope_x * direction[..., 0] - self.slope_y * direction[..., 1]
        )
        return along / steep

    def partials(self, direction: FloatArray, cosine: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of that cosine with either slope (R, C)."""
        square = 1.0 + self.slope_x**2 + self.slope_y**2
        steep = np.sqrt(square)
        return (
            -direction[..., 0] / steep - cosine * self.slope_x / square,
            -direction[..., 1] / steep - cosine * self.slope_y / square,
        )
