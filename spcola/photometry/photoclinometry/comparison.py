"""Images and what is expected of a surface, on the points of its grid: for eyes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError
from spcola.grids import Maplet
from spcola.grids.gaps import filled
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.image_equations import ImageState, compare_image, scaled
from spcola.photometry.photoclinometry.image_window import (
    GridPoints,
    ImageWindow,
    open_ground,
    window_over,
)
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.surface import Surface, resampled_points
from spcola.photometry.secondary_light import SecondaryLight
from spcola.shape import RayCaster

# Share of the cells around a point that a camera has to see.
_SEEN = 0.5


@dataclass(frozen=True, eq=False)
class Comparison:
    """Brightness of an image, and what a surface lets expect, at the points of a grid.

    Both are those of the pixel in which a point lies: nothing is interpolated.

    Attributes
    ----------
    name : str
        Of the image.
    observed, expected : (R, C) ndarrays
        In the image's numbers, with its λ. NaN where the image does not show a point, and where the
        ground of the grid does not fill the pixel.
    residual : (R, C) ndarray
        observed / expected − 1 where the pixel counted: NaN in shadow and where it is saturated.
    """

    name: str
    observed: FloatArray
    expected: FloatArray
    residual: FloatArray

    @classmethod
    def on_grid(
        cls,
        maplet: Maplet,
        image: SpcImage,
        *,
        shift_px: tuple[float, float] = (0.0, 0.0),
        gradient: tuple[float, float] = (0.0, 0.0),
        beyond: Sequence[RayCaster] = (),
        light: SecondaryLight | None = None,
        options: PhotoclinometryOptions | None = None,
    ) -> Comparison | None:
        """Return the comparison of an image with a maplet; None where it shows too little of it.

        Parameters
        ----------
        maplet : Maplet
            Heights and relative albedo.
        image : SpcImage
            With pixels.
        shift_px, gradient : two floats each
            As its :class:`ImageFit` has them.
        beyond : sequence of RayCaster, optional
            The whole body, and maplets around, which hide and shades ground.
        light : SecondaryLight, optional
            Of an image that shows ground in the shade.
        options : PhotoclinometryOptions, optional
            Photometric function and point spread of the solution.

        Raises
        ------
        InvalidValueError
            If the maplet has no height at all, or the image no pixels.
        """
        options = options or PhotoclinometryOptions()
        if not maplet.valid.any():
            raise InvalidValueError("has no height", maplet.name)
        if image.pixels is None:
            raise InvalidValueError("has no pixels", image.name, "put its .DAT into IMAGEFILES")
        grid, height = maplet.grid, filled(maplet.height)
        coarse = grid.with_gsd(grid.gsd * options.levels[0])
        rough = resampled_points(height, grid, coarse)
        opened = open_ground(image, coarse, rough, beyond, grid)
        window = window_over(image, GridPoints.of(grid, height), coarse, opened, light=light)
        if window is None:
            return None
        state = ImageState(float("nan"), np.array(gradient), np.array(shift_px), float("nan"))
        surface = Surface(grid, height, at_cells(filled(maplet.albedo)))
        return compare_on_grid(window, surface, state, maplet.valid, options)


def compare_on_grid(
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    known: BoolArray,
    options: PhotoclinometryOptions,
) -> Comparison | None:
    """Take observed and expected pixels to the points of a grid; None where too few are shown.

    Parameters
    ----------
    window : ImageWindow
    surface : Surface
    state : ImageState
        Its λ and spread may be unknown.
    known : (R, C) ndarray of bool
        Points with a height.
    options : PhotoclinometryOptions
    """
    compared = compare_image(window, surface, state, options)
    if not compared.enough:
        return None
    used = compared.used
    scale = scaled(window.pixels[used], compared.expected[used], state, options).scale
    u, v = window.places(surface.height, state.shift)
    sample, line = (np.floor(w).astype(np.intp) for w in (u, v))
    height, width = window.pixels.shape
    inside = (sample >= 0) & (sample < width) & (line >= 0) & (line < height)
    seen, _ = window.seen_and_lit(surface)
    shown = inside & known & (at_cells(np.pad(seen, 1, mode="edge")) > _SEEN)
    place = np.where(inside, line, 0), np.where(inside, sample, 0)
    observed, expected = window.pixels[place], scale * compared.expected[place]
    shown &= np.isfinite(expected)
    observed, expected = (np.where(shown, layer, np.nan) for layer in (observed, expected))
    with np.errstate(divide="ignore", invalid="ignore"):
        residual = np.where(used[place], observed / expected - 1.0, np.nan)
    return Comparison(window.name, observed, expected, residual)
