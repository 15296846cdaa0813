"""The shape as a camera sees it: a coarse picture of the whole frame, and its centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage, ray
from spcola.camera.linescan import LineScanImage
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.shape import RayCaster

View = SpcImage | LineScanImage

# A point begins so much of the radius above its facet on the way to the Sun.
_ABOVE = 1e-4


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """The shape in a frame, one value for each cell of `step` × `step` pixels.

    Parameters
    ----------
    step : int
        Pixels along a side of a cell.
    brightness : (R, C) ndarray
        Relative brightness; 0 in shadow and off the body.
    body : (R, C) bool ndarray
        Whether the ray through the cell's centre meets the shape.
    points : (R, C, 3) ndarray
        Where it does, body-fixed, metres; NaN off the body.
    """

    step: int
    brightness: FloatArray
    body: BoolArray
    points: FloatArray


@dataclass(frozen=True)
class CenterView:
    """Geometry at the frame's centre; NaN where it does not show the body.

    Parameters
    ----------
    range_m : float
        From the camera to the ground in the frame's centre; if that is sky, to the body's centre.
    resolution_m : float
        Size of a pixel at that range.
    phase, emission, incidence : float
        Radians; the phase angle is that at the body's centre where the frame's centre shows sky.
    """

    range_m: float
    resolution_m: float
    phase: float
    emission: float
    incidence: float


def render_frame(
    caster: RayCaster,
    image: View,
    *,
    step: int = 1,
    function: PhotometricFunction = lunar_lambert,
) -> RenderedFrame:
    """Return the shape as the camera of an image sees it, with cast shadows.

    Parameters
    ----------
    caster : RayCaster
        Of the shape.
    image : SpcImage or LineScanImage
        State and camera; no pixels are needed.
    step : int
        Pixels along a side of a cell; cells that do not fit into the frame are left out.
    function : PhotometricFunction
        Lommel-Seeliger with Lambert if not given.
    """
    width, height = image.size
    rows, columns = height // step, width // step
    line, pixel = np.meshgrid(_centers(rows, step), _centers(columns, step), indexing="ij")
    origins, beams = _rays(image, pixel.ravel(), line.ravel())
    # A ray that is not finite meets nothing.
    hits = caster.cast(origins, beams)
    body = hits.hit
    value = np.zeros(len(beams))
    points = np.where(body[:, None], hits.points, np.nan)
    value[body] = _brightness(
        caster, image, (points[body], hits.normals[body], beams[body]), function
    )
    shape = (rows, columns)
    return RenderedFrame(step, value.reshape(shape), body.reshape(shape), points.reshape(*shape, 3))


def center_view(caster: RayCaster | None, image: View) -> CenterView:
    """Return range, resolution and angles at the centre of the frame.

    Parameters
    ----------
    caster : RayCaster, optional
        Of the shape; without one the body's centre is taken.
    image : SpcImage or LineScanImage
    """
    width, height = image.size
    middle = np.array([[(width + 1) / 2.0, (height + 1) / 2.0]])
    (place,), beam = _rays(image, middle[:, 0], middle[:, 1])
    emission = incidence = np.nan
    away = float(np.linalg.norm(place))
    toward = place / away
    if caster is not None and np.isfinite(beam).all():
        hits = caster.cast(place, beam)
        if hits.hit[0]:
            away, toward = float(hits.distance[0]), -beam[0]
            emission, incidence = (_angle(hits.normals[0], way) for way in (toward, image.sun))
    phase = _angle(toward, image.sun)
    return CenterView(away, away * image.pixel_angle, phase, emission, incidence)


def footprint(caster: RayCaster, image: View) -> FloatArray:
    """Return where the four corners of a frame lie on the shape (4, 3), metres; NaN off it.

    In the order upper left, upper right, lower right, lower left; corners, not centres of pixels.

    Parameters
    ----------
    caster : RayCaster
    image : SpcImage or LineScanImage
    """
    right, down = (count + 0.5 for count in image.size)
    pixel, line = np.array([0.5, right, right, 0.5]), np.array([0.5, 0.5, down, down])
    hits = caster.cast(*_rays(image, pixel, line))
    points: FloatArray = np.where(hits.hit[:, None], hits.points, np.nan)
    return points


def _rays(image: View, pixel: FloatArray, line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return origins (N, 3), metres, and unit vectors (N, 3) through pixels and lines (N,)."""
    if isinstance(image, LineScanImage):
        return image.rays(pixel, line)
    beams = ray(image, pixel, line)
    return np.broadcast_to(image.position, beams.shape), beams


def _centers(count: int, step: int) -> FloatArray:
    """Return pixel coordinates of cells' centres; that of the first pixel is 1."""
    centers: FloatArray = step * np.arange(count) + (step + 1) / 2.0
    return centers


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between unit vectors, radians."""
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def _brightness(
    caster: RayCaster,
    image: View,
    seen: tuple[FloatArray, FloatArray, FloatArray],
    function: PhotometricFunction,
) -> FloatArray:
    """Return the brightness (N,) of ground; 0 where the Sun does not reach it.

    `seen` are points, normals and beams from the camera, (N, 3) each.
    """
    points, normals, beams = seen
    cos_incidence = normals @ image.sun
    cos_emission = np.abs(np.einsum("ij,ij->i", normals, beams))
    phase = np.arccos(np.clip(-beams @ image.sun, -1.0, 1.0))
    value = np.zeros(len(points))
    lit = np.flatnonzero(cos_incidence > 0.0)
    starts = points[lit] + _ABOVE * caster.radius * normals[lit]
    lit = lit[~caster.cast(starts, np.broadcast_to(image.sun, starts.shape)).hit]
    value[lit] = function(cos_incidence[lit], cos_emission[lit], phase[lit])
    return value
