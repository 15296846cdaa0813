"""An image over a grid: its pixels there, and where points of the grid are projected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage, partials_position, project_image
from spcola.grids import MapletGrid
from spcola.photometry.ground import Ground, at_cells
from spcola.photometry.ortho_image import stop_at_other_ground
from spcola.photometry.photoclinometry.cell_pixels import Places
from spcola.photometry.photoclinometry.surface import resampled_points
from spcola.photometry.shadows import cast_shadow, hidden
from spcola.shape import RayCaster

# Pixels around the ground in a window.
_MARGIN = 3


@dataclass(frozen=True, eq=False)
class ImageWindow:
    """An image over a grid.

    Attributes
    ----------
    name : str
    pixels : (H, W) ndarray
        Brightness in a window of the image.
    usable : (H, W) ndarray of bool
        Between the image's thresholds: neither dark as shadow nor saturated.
    u, v : (R, C) ndarrays
        Sample and line of each point at `height`; pixel k of the window reaches from k to k + 1.
    up_u, up_v : (R, C) ndarrays
        Their derivatives by the height, pixels a metre.
    height : (R, C) ndarray
        Metres.
    sun : (3,) ndarray
        Unit vector along the grid's axes.
    eye : (3, R − 1, C − 1) ndarray
        Unit vectors from the cells to the camera, along the grid's axes.
    phase : (R − 1, C − 1) ndarray
        Radians.
    camera : (3,) ndarray
        Its place along the grid's axes from the grid's first point: grid steps, grid steps, metres.
    facing : float
        Sign of the area, in (sample, line), of cells that face the camera.
    open_seen, open_lit : (R − 1, C − 1) ndarrays
        Shares of cells that ground beyond the grid does not hide, and does not shade.
    """

    name: str
    pixels: FloatArray
    usable: BoolArray
    u: FloatArray
    v: FloatArray
    up_u: FloatArray
    up_v: FloatArray
    height: FloatArray
    sun: FloatArray
    eye: FloatArray
    phase: FloatArray
    camera: FloatArray
    facing: float
    open_seen: FloatArray
    open_lit: FloatArray

    @classmethod
    def of(
        cls,
        image: SpcImage,
        grid: MapletGrid,
        height: FloatArray,
        open_ground: tuple[FloatArray, FloatArray],
    ) -> ImageWindow | None:
        """Cut a window out of an image with pixels; None if it does not show the grid.

        Parameters
        ----------
        image : SpcImage
        grid : MapletGrid
        height : (R, C) ndarray
            Metres, all known; they may change later by far less than the distance.
        open_ground : two (R − 1, C − 1) ndarrays
            `open_seen` and `open_lit`.
        """
        points = grid.points(height)
        pixel, line = project_image(image, points)
        if image.pixels is None or not np.isfinite(pixel + line).all():
            return None
        shape = image.camera.height, image.camera.width
        window = tuple(
            slice(max(int(place.min()) - _MARGIN, 0), min(int(place.max()) + _MARGIN, size))
            for place, size in zip((line, pixel), shape, strict=True)
        )
        if any(one.start >= one.stop for one in window):
            return None
        pixels = np.asarray(image.pixels[window], dtype=np.float64)
        low, high = image.thresholds
        up = np.moveaxis(partials_position(image, points) @ grid.uz, -1, 0)
        away = (image.position - at_cells(points)) @ grid.axes.T
        eye = np.moveaxis(away / np.linalg.norm(away, axis=-1, keepdims=True), -1, 0)
        sun = grid.axes @ image.sun
        u, v = pixel - 0.5 - window[1].start, line - 0.5 - window[0].start
        across, down = (np.array([w[j] - w[0, 0] for w in (u, v)]) for j in ((0, -1), (-1, 0)))
        camera = grid.axes @ (image.position - grid.center) / [grid.gsd, grid.gsd, 1.0]
        facing = float(np.sign(across[0] * down[1] - across[1] * down[0]))
        return cls(
            image.name, pixels, (pixels > low) & (pixels < high), u, v,
            np.ascontiguousarray(up[0]), np.ascontiguousarray(up[1]), np.array(height), sun,
            np.ascontiguousarray(eye),
            np.arccos(np.clip(np.tensordot(sun, eye, 1), -1.0, 1.0)),
            camera + np.array([grid.half_size, grid.half_size, 0.0]), facing, *open_ground,
        )  # fmt: skip

    def pixel_m(self, gsd: float) -> float:
        """Return the side of a square of the area of a pixel on the plane of the grid, metres."""
        across, down = (
            np.array([w[j] - w[0, 0] for w in (self.u, self.v)]) / (self.u.shape[axis] - 1)
            for axis, j in ((1, (0, -1)), (0, (-1, 0)))
        )
        return gsd / float(np.sqrt(abs(across[0] * down[1] - across[1] * down[0])))

    def places(self, height: FloatArray, shift: FloatArray) -> Places:
        """Return sample and line (R, C) of points at other heights, and both derivatives."""
        rise = height - self.height
        return (
            self.u + self.up_u * rise + shift[0],
            self.v + self.up_v * rise + shift[1],
            self.up_u,
            self.up_v,
        )

    def seen_and_lit(self, height: FloatArray, gsd: float) -> tuple[FloatArray, FloatArray]:
        """Return the shares (R − 1, C − 1) of each cell that the camera sees, and that are lit."""
        seen = self.open_seen * at_cells(1.0 - hidden(height, self.camera))
        return seen, self.open_lit * self.lit(height, gsd, self.sun)

    def lit(self, height: FloatArray, gsd: float, sun: FloatArray) -> FloatArray:
        """Return the share (R − 1, C − 1) of each cell in no shadow of the grid's own ground."""
        return at_cells(1.0 - cast_shadow(height, sun * [1.0, 1.0, gsd]))


def open_ground(
    image: SpcImage, grid: MapletGrid, height: FloatArray, beyond: Sequence[RayCaster]
) -> tuple[FloatArray, FloatArray]:
    """Return where ground beyond a grid neither hides nor shades its points (R, C), 0 or 1."""
    seen, lit = np.ones((2, *grid.shape), dtype=np.bool_)
    if beyond:
        ground = Ground.of(grid, height)
        eye, sun = ground.eye(image), np.broadcast_to(ground.sun(image), (*grid.shape, 3))
        for surface in beyond:
            stop_at_other_ground(seen, surface, ground, eye)
            stop_at_other_ground(lit, surface, ground, sun)
    return seen.astype(np.float64), lit.astype(np.float64)


def window_over(
    image: SpcImage,
    grid: MapletGrid,
    height: FloatArray,
    coarse: MapletGrid,
    ground: tuple[FloatArray, FloatArray],
) -> ImageWindow | None:
    """Return the window of an image over a grid; None if it does not show the grid.

    Parameters
    ----------
    image : SpcImage
    grid : MapletGrid
    height : (R, C) ndarray
        Metres, all known.
    coarse : MapletGrid
        Of the same place.
    ground : two ndarrays
        What :func:`open_ground` gives for the points of `coarse`.
    """
    seen, lit = (at_cells(resampled_points(points, coarse, grid)) for points in ground)
    return ImageWindow.of(image, grid, height, (seen, lit))
