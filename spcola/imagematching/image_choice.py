"""Choice of images that show a grid well enough, from directions that determine its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage, partials_position, project_image
from spcola.grids import MapletGrid
from spcola.photometry import MOST_INCIDENCE
from spcola.photometry.functions import PhotometricFunction

# Points across a grid that are tested against the frame.
_LATTICE = 9
# Prior information of a direction, pixels² a square metre, below that of any image.
_NONE = 1e-9
# Expected standard deviations of slopes and of the relative albedo, and relative error of the
# brightness of a cell: how much of slopes and albedo images in one light leave open.
_SLOPE, _ALBEDO, _BRIGHTNESS = 0.3, 0.05, 0.03


@dataclass(frozen=True)
class ChoiceOptions:
    """Criteria for images.

    Parameters
    ----------
    most : int
        Most images of one grid.
    coarsest : float
        Longest extent of a pixel on the grid, grid steps.
    most_emission, most_incidence : float
        From the grid's normal, radians.
    least_share : float
        Share of the grid that has to lie in the frame.
    light : PhotometricFunction, optional
        With it, images are chosen for light that differs, too: for photoclinometry.
    """

    most: int = 20
    coarsest: float = 4.0
    most_emission: float = 1.2217304763960306
    most_incidence: float = float(MOST_INCIDENCE)
    least_share: float = 0.05
    light: PhotometricFunction | None = None


def choose_images(
    grid: MapletGrid, images: Sequence[SpcImage], *, options: ChoiceOptions | None = None
) -> list[SpcImage]:
    """Return the images that show `grid`, at most `most`, the most informative first.

    Each next image adds most to the determinant of the normal matrix of the grid's place [9]: by
    fine pixels, a large part of the grid, or another direction of view. With `light`, that of the
    normal matrix of slopes and albedo [21] is multiplied by it: images in a light that no other
    has come before more of the same.

    Parameters
    ----------
    grid : MapletGrid
        In the frame of the images.
    images : sequence of SpcImage
        States; pixels are not needed.
    options : ChoiceOptions, optional
    """
    options = options or ChoiceOptions()
    usable = [
        (image, matrix)
        for image in images
        if (matrix := _information(grid, image, options)) is not None
    ]
    chosen: list[SpcImage] = []
    total = np.diag([*[_NONE] * 3, *[_SLOPE**-2] * 2, _ALBEDO**-2])
    while usable and len(chosen) < options.most:
        gains = [np.linalg.slogdet(total + matrix)[1] for _, matrix in usable]
        image, matrix = usable.pop(int(np.argmax(gains)))
        total = total + matrix
        chosen.append(image)
    return chosen


def _information(grid: MapletGrid, image: SpcImage, options: ChoiceOptions) -> FloatArray | None:
    """Return an image's information (6, 6) on the grid's place, slopes and albedo.

    None if it shows too little; of slopes and albedo only with a light.
    """
    away = image.position - grid.center
    distance = float(np.linalg.norm(away))
    if away @ grid.uz < distance * np.cos(options.most_emission):
        return None
    if image.sun @ grid.uz < np.cos(options.most_incidence):
        return None
    partials = partials_position(image, grid.center)
    if not np.isfinite(partials).all():
        return None
    # Extent of a pixel on the ground, grid steps: longest and shortest.
    extent = 1.0 / np.linalg.svd(grid.gsd * partials @ grid.axes[:2].T, compute_uv=False)
    if not extent[-1] <= options.coarsest:
        return None
    steps = np.linspace(-grid.half_size, grid.half_size, _LATTICE) * grid.gsd
    lattice = grid.center + (steps[:, None, None] * grid.uy + steps[None, :, None] * grid.ux)
    pixel, line = project_image(image, lattice)
    inside = (pixel >= 0.5) & (pixel < image.camera.width + 0.5)
    inside &= (line >= 0.5) & (line < image.camera.height + 0.5)
    share = float(np.mean(inside))
    if share < options.least_share:
        return None
    # Pixels finer than the grid's cells add no information.
    finer = max(1.0, 1.0 / extent[-1])
    information = np.zeros((6, 6))
    information[:3, :3] = share * partials.T @ partials / finer**2
    if options.light is not None:
        row = _by_slopes_and_albedo(options.light, grid.axes @ image.sun, grid.axes @ away)
        # A coarse pixel has one brightness for all its cells.
        cells = max(1.0, float(np.prod(extent)))
        information[3:, 3:] = share * np.outer(row, row) / (cells * _BRIGHTNESS**2)
    return information


def _by_slopes_and_albedo(
    function: PhotometricFunction, sun: FloatArray, away: FloatArray
) -> FloatArray:
    """Return the derivatives (3,) of ln I by both slopes and ln albedo on level ground [19]."""
    eye = away / np.linalg.norm(away)
    phase = np.arccos(np.clip(sun @ eye, -1.0, 1.0))
    found = function.partials(sun[2:], eye[2:], phase)
    by_slopes = -(found.by_cos_incidence * sun[:2] + found.by_cos_emission * eye[:2])
    return np.array([*(by_slopes / found.value), 1.0])
