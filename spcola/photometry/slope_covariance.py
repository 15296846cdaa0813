"""Normal equations of photoclinometry: the information of images on slopes, from geometry.

A brightness ``I = λ (1 + tz) Φ(cos i, cos e, phase)`` [16] changes with both slopes and the albedo
of its ground. Over all images that show a point lit these partials make a 3 × 3 normal matrix for
(tx, ty, tz); its inverse is the covariance of the slopes, whatever the brightnesses are (Gaskell et
al., eqs. 16 to 21). A point that too few images show lit has no slope from images.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.camera import SpcImage, project_image
from spcola.grids import Maplet
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.photometry.ground import Ground
from spcola.photometry.shadows import cast_shadow

MOST_INCIDENCE = np.radians(80.0)
"""Largest incidence angle used, radians (Sun 10° high): shadows of roughness finer than the grid
are not modelled below it."""
# Unknowns of a point: two slopes and the albedo.
_UNKNOWNS = 3
# Share of the information of independent images below which slopes are not separable (rounding).
_SEPARABLE = 1e-9
# An image whose pixels are wider than this, grid steps, shows no detail of the grid.
_COARSEST = 5.0


@dataclass(frozen=True, eq=False)
class SlopeVariance:
    """Variance of slopes from images at each point of a grid.

    Parameters
    ----------
    along_x, along_y : (R, C) ndarrays
        Variance of the slopes ∂h/∂x and ∂h/∂y for independent brightness errors, relative to the
        image's mean brightness; infinite where the images do not determine the slopes.
    images : (R, C) ndarray of int
        Number of images that show the point lit.
    """

    along_x: FloatArray
    along_y: FloatArray
    images: IntArray

    @property
    def defined(self) -> BoolArray:
        """Where images determine both slopes (R, C)."""
        return np.isfinite(self.along_x)


def slope_variance(
    maplet: Maplet,
    images: Iterable[SpcImage],
    *,
    function: PhotometricFunction = lunar_lambert,
    framed: bool = True,
) -> SlopeVariance:
    """Return the variance of the slopes of `maplet` as determined by `images` [16 – 21].

    An image is used at a point that it shows: in front of the camera and on its detector, turned
    towards it, lit at an incidence below :data:`MOST_INCIDENCE` and in no shadow that the maplet
    itself casts; and, where the image has pixels, neither as dark as shadow nor saturated there.
    The information of a pixel that covers n points is divided among them.

    Parameters
    ----------
    maplet : Maplet
        Its slopes are those of its heights.
    images : iterable of SpcImage
        With or without pixels; taken one by one.
    function : PhotometricFunction
    framed : bool
        Whether a point has to lie on the detector: not if `images` represent others taken in the
        same light.

    Returns
    -------
    SlopeVariance
        No slope is defined where the maplet has none.
    """
    ground = Ground.of(maplet.grid, maplet.height)
    matrix = np.zeros((6, *maplet.grid.shape))
    count = np.zeros(maplet.grid.shape, dtype=np.int64)
    for image in images:
        if ground.pixel(image) > _COARSEST:
            continue
        lit = _lit(ground, image, framed)
        if lit.any():
            count += lit
            _add_image(matrix, ground, image, lit, function)
    return _reduced(matrix, count)


def _lit(ground: Ground, image: SpcImage, framed: bool) -> BoolArray:
    """Where (R, C) the image shows lit ground."""
    sun = ground.sun(image)
    lit: BoolArray = ground.cosine(sun) > np.cos(MOST_INCIDENCE)
    lit &= ground.cosine(ground.eye(image)) > 0.0
    if framed and lit.any():
        lit &= _well_exposed(ground, image)
    if lit.any():
        grid = ground.grid
        lit &= ~cast_shadow(ground.height, sun * [1.0, 1.0, grid.gsd])
    return lit


def _well_exposed(ground: Ground, image: SpcImage) -> BoolArray:
    """Where (R, C) a point lies on the detector, and its pixel is neither shadow nor saturated."""
    pixel, line = project_image(image, ground.points)
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
    ground: Ground,
    image: SpcImage,
    lit: BoolArray,
    function: PhotometricFunction,
) -> None:
    """Add the information where `lit`: xx, xy, yy, xa, ya, aa of the normal matrix."""
    sun, eye = ground.sun(image), ground.eye(image)
    incidence, emission = ground.cosine(sun), ground.cosine(eye)
    phase = np.arccos(np.clip(eye @ sun, -1.0, 1.0))
    shade = function.partials(incidence, emission, phase)
    # λ makes the means equal: exposures are chosen for a mean well between the thresholds.
    scale = 1.0 / (float(np.mean(shade.value[lit])) * max(ground.pixel(image), 1.0))
    rows = [
        scale * (shade.by_cos_incidence * sun_part + shade.by_cos_emission * eye_part)
        for sun_part, eye_part in zip(
            ground.partials(sun, incidence), ground.partials(eye, emission), strict=True
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
