"""Normal equations of photoclinometry: the information of images on slopes, from geometry.

A brightness ``I = λ (1 + tz) Φ(cos i, cos e, phase)`` [16] changes with both slopes and the albedo
of its ground. Over all images that show a point lit these partials make a 3 × 3 normal matrix for
(tx, ty, tz); its inverse is the covariance of the slopes, whatever the brightnesses are (Gaskell et
al., eqs. 16 to 21). Ground that too few images show lit has no slope from images. Slopes are those
of the cells between four points, as in photoclinometry.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.camera import SpcImage, project_image
from spcola.grids import Maplet
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.photometry.ground import Facets, Ground, at_cells
from spcola.photometry.shadows import cast_shadow

MOST_INCIDENCE = np.radians(80.0)
"""Largest incidence angle used, radians (Sun 10° high): shadows of roughness finer than the grid
are not modelled below it."""
# Unknowns of a cell: two slopes and the albedo.
_UNKNOWNS = 3
# Share of the information of independent images below which slopes are not separable (rounding).
_SEPARABLE = 1e-9
# A cell is in shadow if this share of its corners is, or more; slopes are determined at a point if
# they are in this share of the cells about it.
_SHADED = 0.5
# An image whose pixels are wider than this, grid steps, shows no detail of the grid.
_COARSEST = 5.0


@dataclass(frozen=True, eq=False)
class SlopeVariance:
    """Variance of slopes from images in each cell of a grid, between four points.

    Parameters
    ----------
    along_x, along_y : (R − 1, C − 1) ndarrays
        Variance of the slopes ∂h/∂x and ∂h/∂y for independent brightness errors, relative to the
        image's mean brightness; infinite where the images do not determine the slopes.
    images : (R − 1, C − 1) ndarray of int
        Number of images that show the cell lit.
    """

    along_x: FloatArray
    along_y: FloatArray
    images: IntArray

    @property
    def defined(self) -> BoolArray:
        """Where images determine both slopes (R − 1, C − 1)."""
        return np.isfinite(self.along_x)

    @property
    def at_points(self) -> BoolArray:
        """Points (R, C) about which images determine the slopes of half of the cells, or more."""
        defined = np.pad(self.defined.astype(np.float64), 1, constant_values=np.nan)
        return at_cells(defined) >= _SHADED


def slope_variance(
    maplet: Maplet,
    images: Iterable[SpcImage],
    *,
    function: PhotometricFunction = lunar_lambert,
    framed: bool = True,
) -> SlopeVariance:
    """Return the variance of the slopes of `maplet` as determined by `images` [16 – 21].

    An image is used for a cell that it shows: in front of the camera and its middle on the
    detector, turned towards it, lit at an incidence below :data:`MOST_INCIDENCE` and with most
    corners in no shadow that the maplet itself casts; and, where the image has pixels, neither as
    dark as shadow nor saturated there. The information of a pixel that covers n cells is divided
    among them.

    Parameters
    ----------
    maplet : Maplet
        Its slopes are those of its heights.
    images : iterable of SpcImage
        With or without pixels; taken one by one.
    function : PhotometricFunction
    framed : bool
        Whether a cell has to lie on the detector: not if `images` represent others taken in the
        same light.

    Returns
    -------
    SlopeVariance
        No slope is defined where the maplet has none.
    """
    ground = Ground.of(maplet.grid, maplet.height)
    cells = Facets.of(ground)
    matrix = np.zeros((6, *cells.slope_x.shape))
    count = np.zeros(cells.slope_x.shape, dtype=np.int64)
    for image in images:
        pixel = ground.pixel(image)
        if pixel > _COARSEST:
            continue
        lit = _lit(ground, cells, image, framed)
        if lit.any():
            count += lit
            _add_image(matrix, cells, image, lit, (function, max(pixel, 1.0)))
    return _reduced(matrix, count)


def _lit(ground: Ground, cells: Facets, image: SpcImage, framed: bool) -> BoolArray:
    """Cells (R − 1, C − 1) of the ground that the image shows lit."""
    sun = ground.sun(image)
    lit: BoolArray = cells.cosine(sun) > np.cos(MOST_INCIDENCE)
    lit &= cells.cosine(cells.eye(image)) > 0.0
    if framed and lit.any():
        lit &= _well_exposed(cells, image)
    if lit.any():
        shadow = cast_shadow(ground.height, sun * [1.0, 1.0, ground.grid.gsd])
        lit &= at_cells(shadow.astype(np.float64)) < _SHADED
    return lit


def _well_exposed(cells: Facets, image: SpcImage) -> BoolArray:
    """Cells (R − 1, C − 1) on the detector, in a pixel that is neither shadow nor saturated."""
    pixel, line = project_image(image, cells.middle)
    width, height = image.camera.width, image.camera.height
    inside: BoolArray = (pixel >= 0.5) & (pixel < width + 0.5)
    inside &= (line >= 0.5) & (line < height + 0.5)
    if image.pixels is None:
        return inside
    columns, rows = (
        np.rint(np.where(inside, place, 1.0)).astype(int) - 1 for place in (pixel, line)
    )
    brightness = image.pixels[np.minimum(rows, height - 1), np.minimum(columns, width - 1)]
    low, high = image.thresholds
    return inside & (brightness > low) & (brightness < high)


def _add_image(
    matrix: FloatArray,
    cells: Facets,
    image: SpcImage,
    lit: BoolArray,
    imaging: tuple[PhotometricFunction, float],
) -> None:
    """Add the information where `lit`: xx, xy, yy, xa, ya, aa of the normal matrix.

    `imaging` is the photometric function, and the width of a pixel in grid steps, at least one.
    """
    function, pixel = imaging
    sun, eye = cells.axes @ image.sun, cells.eye(image)
    incidence, emission = cells.cosine(sun), cells.cosine(eye)
    phase = np.arccos(np.clip(eye @ sun, -1.0, 1.0))
    shade = function.partials(incidence, emission, phase)
    # λ makes the means equal: exposures are chosen for a mean well between the thresholds.
    scale = 1.0 / (float(np.mean(shade.value[lit])) * pixel)
    rows = [
        scale * (shade.by_cos_incidence * sun_part + shade.by_cos_emission * eye_part)
        for sun_part, eye_part in zip(
            cells.partials(sun, incidence), cells.partials(eye, emission), strict=True
        )
    ]
    x, y, albedo = (np.where(lit, row, 0.0) for row in (*rows, scale * shade.value))
    matrix += [x * x, x * y, y * y, x * albedo, y * albedo, albedo * albedo]


def _reduced(matrix: FloatArray, count: IntArray) -> SlopeVariance:
    """Eliminate the albedo from the normal matrices and invert them for the slopes."""
    xx, xy, yy, xa, ya, aa = matrix
    with np.errstate(divide="ignore", invalid="ignore"):
        left_xx, left_xy, left_yy = xx - xa * xa / aa, xy - xa * ya / aa, yy - ya * ya / aa
        determinant = left_xx * left_yy - left_xy**2
        known = (count >= _UNKNOWNS) & (determinant > _SEPARABLE * xx * yy)
        return SlopeVariance(
            np.where(known, left_yy / determinant, np.inf),
            np.where(known, left_xx / determinant, np.inf),
            count,
        )
