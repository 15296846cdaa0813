"""What images tell of slopes: the normal equations of photoclinometry, from their geometry.

A brightness ``I = λ (1 + tz) Φ(cos i, cos e, phase)`` [16] changes with both slopes and the albedo
of its ground. Over all images that show a point lit these partials make a 3 × 3 normal matrix for
(tx, ty, tz); its inverse says how well the slopes are known, whatever the brightnesses are
(Gaskell et al., eqs. 16 to 21). A point that too few images show lit has no slope from images.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.heights.slopes import slopes_of
from spcola.image import SpcImage
from spcola.kernel import kernel
from spcola.maplet import Maplet
from spcola.photometry import PhotometricFunction, lunar_lambert
from spcola.projection import project_image

MOST_INCIDENCE = np.radians(80.0)
"""Ground on which the Sun stands lower than 10° does not enter, radians: what lies in the shadow of
roughness below the grid is not modelled."""
# Unknowns of a point: two slopes and the albedo.
_UNKNOWNS = 3
# Below this share of what independent images would tell, the slopes are not separable: rounding.
_SEPARABLE = 1e-9
# An image whose pixels are wider than this, grid steps, shows none of the grid's detail.
_COARSEST = 5.0
# Change of a cosine over which a photometric function is differenced.
_COSINE = 1e-5


@dataclass(frozen=True, eq=False)
class SlopeVariance:
    """How well images tell the slopes at each point of a grid.

    Parameters
    ----------
    along_x, along_y : (R, C) ndarrays
        Variance of the slopes ∂h/∂x and ∂h/∂y for brightnesses that err independently by their
        image's mean brightness; infinite where the images do not determine the slopes.
    images : (R, C) ndarray of int
        How many images show the point lit.
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
    """Return how well `images` tell the slopes of `maplet` [16 – 21].

    An image counts at a point that it shows: in front of the camera and on its detector, turned
    towards it, lit at an incidence below :data:`MOST_INCIDENCE` and in no shadow that the maplet
    itself casts; and, where the image has pixels, neither as dark as shadow nor saturated there.
    A pixel that covers n points gives each of them an n-th of what it tells.

    Parameters
    ----------
    maplet : Maplet
        Its slopes are those of its heights.
    images : iterable of SpcImage
        With or without pixels; taken one by one.
    function : callable
        Photometric function Φ.
    framed : bool
        Whether a point has to lie on the detector: not if `images` stand for others that were
        taken in the same light.

    Returns
    -------
    SlopeVariance
        No slope is defined where the maplet has none.
    """
    ground = _Ground.of(maplet)
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


@dataclass(frozen=True, eq=False)
class _Ground:
    """A maplet as photoclinometry sees it: axes are the maplet's own."""

    maplet: Maplet
    points: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray

    @classmethod
    def of(cls, maplet: Maplet) -> _Ground:
        return cls(maplet, maplet.points(), *slopes_of(maplet.height, maplet.grid.gsd))

    def pixel(self, image: SpcImage) -> float:
        """Width of a pixel on the ground that the camera looks straight at, grid steps."""
        grid = self.maplet.grid
        away = float(np.linalg.norm(image.position - grid.center))
        return image.camera.pixel_angle * away / grid.gsd

    def sun(self, image: SpcImage) -> FloatArray:
        """Direction of the Sun (3,) along Ux, Uy, Uz."""
        direction: FloatArray = self.maplet.grid.axes @ image.sun
        return direction

    def eye(self, image: SpcImage) -> FloatArray:
        """Unit vectors (R, C, 3) to the camera along Ux, Uy, Uz."""
        away = (image.position - self.points) @ self.maplet.grid.axes.T
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


def _lit(ground: _Ground, image: SpcImage, framed: bool) -> BoolArray:
    """Where (R, C) the image shows lit ground."""
    sun = ground.sun(image)
    lit: BoolArray = ground.cosine(sun) > np.cos(MOST_INCIDENCE)
    lit &= ground.cosine(ground.eye(image)) > 0.0
    if framed and lit.any():
        lit &= _well_exposed(ground, image)
    if lit.any():
        grid = ground.maplet.grid
        lit &= ~cast_shadow(ground.maplet.height, sun * [1.0, 1.0, grid.gsd])
    return lit


def _well_exposed(ground: _Ground, image: SpcImage) -> BoolArray:
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
    exposed: BoolArray = inside & (brightness > low) & (brightness < high)
    return exposed


def _add_image(
    matrix: FloatArray,
    ground: _Ground,
    image: SpcImage,
    lit: BoolArray,
    function: PhotometricFunction,
) -> None:
    """Add what an image tells where it is `lit`: xx, xy, yy, xa, ya, aa of the normal matrix."""
    sun, eye = ground.sun(image), ground.eye(image)
    incidence, emission = ground.cosine(sun), ground.cosine(eye)
    phase = np.arccos(np.clip(eye @ sun, -1.0, 1.0))
    with np.errstate(invalid="ignore"):
        value = function(incidence, emission, phase)
        by_sun = function(incidence + _COSINE, emission, phase) - function(
            incidence - _COSINE, emission, phase
        )
        by_eye = function(incidence, emission + _COSINE, phase) - function(
            incidence, emission - _COSINE, phase
        )
    # λ makes the means equal: an image is exposed so that its ground is neither dark nor cut.
    scale = 1.0 / (float(np.mean(value[lit])) * max(ground.pixel(image), 1.0))
    rows = [
        scale * (by_sun * sun_part + by_eye * eye_part) / (2.0 * _COSINE)
        for sun_part, eye_part in zip(
            ground.partials(sun, incidence), ground.partials(eye, emission), strict=True
        )
    ]
    x, y, albedo = (np.where(lit, row, 0.0) for row in (*rows, scale * value))
    matrix += [x * x, x * y, y * y, x * albedo, y * albedo, albedo * albedo]


def _reduced(matrix: FloatArray, count: IntArray) -> SlopeVariance:
    """Take the albedo out of the normal matrices and invert what is left for the slopes."""
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


def cast_shadow(height: FloatArray, sun: FloatArray) -> BoolArray:
    """Tell which points of a grid lie in the shadow of others.

    Parameters
    ----------
    height : (R, C) ndarray
        NaN where unknown: nothing stands there.
    sun : (3,) ndarray
        Direction of the Sun along columns, rows and up, in grid steps and the unit of `height`:
        for a unit vector s in maplet axes and heights in metres, (s_x, s_y, gsd · s_z).

    Returns
    -------
    (R, C) ndarray of bool
        All where the Sun is below the plane's horizon; unknown points are never in shadow.
    """
    if sun[2] <= 0.0:
        return np.isfinite(height)
    dark = np.zeros(height.shape, dtype=np.bool_)
    run = float(np.hypot(sun[0], sun[1]))
    if run == 0.0 or not np.isfinite(height).any():
        return dark
    step = np.array([sun[0], sun[1], sun[2]]) / run
    _march(height, step[0], step[1], step[2], float(np.nanmax(height)), dark)
    return dark


@kernel
def _march(
    height: FloatArray, across: float, along: float, rise: float, top: float, dark: BoolArray
) -> None:
    """Follow the ray from each point to the Sun, one grid step at a time, over bilinear ground."""
    rows, columns = height.shape
    for row in range(rows):
        for column in range(columns):
            x, y, ray = float(column), float(row), height[row, column]
            while ray <= top:
                x, y, ray = x + across, y + along, ray + rise
                left, low = int(np.floor(x)), int(np.floor(y))
                if left < 0 or low < 0 or left + 1 >= columns or low + 1 >= rows:
                    break
                u, v = x - left, y - low
                ground = (1.0 - v) * (
                    (1.0 - u) * height[low, left] + u * height[low, left + 1]
                ) + v * ((1.0 - u) * height[low + 1, left] + u * height[low + 1, left + 1])
                if ground > ray:
                    dark[row, column] = True
                    break
