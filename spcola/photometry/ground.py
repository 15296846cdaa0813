"""Slopes of heights on a grid, and their cosines with directions of light and view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, check_shape
from spcola.camera import SpcImage
from spcola.grids import MapletGrid
from spcola.heights.slopes import slopes_of


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
        check_shape(height, grid.shape, "height")
        return cls(grid, height, grid.points(height), *slopes_of(height, grid.gsd))

    def pixel(self, image: SpcImage) -> float:
        """Width of a pixel at nadir on the ground, grid steps."""
        away = float(np.linalg.norm(image.position - self.grid.center))
        return image.camera.pixel_angle * away / self.grid.gsd

    def sun(self, image: SpcImage) -> FloatArray:
        """Direction of the Sun (3,)."""
        return self.grid.axes @ image.sun

    def eye(self, image: SpcImage) -> FloatArray:
        """Unit vectors (R, C, 3) to the camera."""
        away = (image.position - self.points) @ self.grid.axes.T
        return away / np.linalg.norm(away, axis=-1, keepdims=True)

    def cosine(self, direction: FloatArray) -> FloatArray:
        """Cosine (R, C) between the normals and a direction (…, 3) [19]."""
        return _cosine(self.slope_x, self.slope_y, direction)


@dataclass(frozen=True, eq=False)
class Facets:
    """The cells between four points of a ground, as planes: where slopes from images are.

    Slopes at points are differences over two steps. They smooth relief before it is lit, and as
    brightness is not linear in slopes the ground then appears displaced.

    Attributes
    ----------
    axes : (3, 3) ndarray
        Ux, Uy and Uz of the grid, as rows.
    middle : (R − 1, C − 1, 3) ndarray
        Mean of the known corners, body-fixed, metres.
    slope_x, slope_y : (R − 1, C − 1) ndarrays
        ∂h/∂x and ∂h/∂y, means of both edges, or one edge if a corner is unknown; else NaN.
    """

    axes: FloatArray
    middle: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray

    @classmethod
    def of(cls, ground: Ground) -> Facets:
        """Return the facets of a ground."""
        high, gsd = ground.height, ground.grid.gsd
        along_x, along_y = np.diff(high, axis=1) / gsd, np.diff(high, axis=0) / gsd
        return cls(
            ground.grid.axes,
            at_cells(ground.points),
            _mean(along_x[1:], along_x[:-1]),
            _mean(along_y[:, 1:], along_y[:, :-1]),
        )

    def eye(self, image: SpcImage) -> FloatArray:
        """Unit vectors (R − 1, C − 1, 3) to the camera, along the grid's axes."""
        away = (image.position - self.middle) @ self.axes.T
        return away / np.linalg.norm(away, axis=-1, keepdims=True)

    def cosine(self, direction: FloatArray) -> FloatArray:
        """Cosine (R − 1, C − 1) between the normals and a direction (…, 3) [19]."""
        return _cosine(self.slope_x, self.slope_y, direction)

    def partials(self, direction: FloatArray, cosine: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of that cosine by either slope (R − 1, C − 1)."""
        square = 1.0 + self.slope_x**2 + self.slope_y**2
        steep = np.sqrt(square)
        return (
            -direction[..., 0] / steep - cosine * self.slope_x / square,
            -direction[..., 1] / steep - cosine * self.slope_y / square,
        )


def at_cells(layer: FloatArray) -> FloatArray:
    """Return the means (R − 1, C − 1, …) of the known corners of each cell of a layer (R, C, …)."""
    return _mean(layer[1:, 1:], layer[1:, :-1], layer[:-1, 1:], layer[:-1, :-1])


def _mean(*layers: FloatArray) -> FloatArray:
    """Mean of the known values; NaN where there is none."""
    total: FloatArray = sum(layers[1:], layers[0])
    # Most layers have no gaps, and this is called for each image in each round.
    if np.isfinite(total).all():
        return total / len(layers)
    known = np.sum([np.isfinite(layer) for layer in layers], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        means: FloatArray = np.sum([np.nan_to_num(layer) for layer in layers], axis=0) / known
    return means


def _cosine(slope_x: FloatArray, slope_y: FloatArray, direction: FloatArray) -> FloatArray:
    """Cosine between the normals of slopes (…) and a direction (…, 3)."""
    along: FloatArray = (
        direction[..., 2] - slope_x * direction[..., 0] - slope_y * direction[..., 1]
    )
    return along / np.sqrt(1.0 + slope_x**2 + slope_y**2)
