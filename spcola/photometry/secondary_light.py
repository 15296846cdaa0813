"""Light that ground in the shade receives from lit ground around it (Gaskell et al., §2.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.camera import SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import filled
from spcola.photometry.functions import PhotometricFunction
from spcola.shape import Hits, RayCaster, shape_heights

__all__ = [
    "SecondaryLight",
    "image_in_shade",
    "name_in_shade",
    "name_of_image",
    "secondary_light",
]

# Places along a side of the grid from which the sky is looked at; rays from each, of equal solid
# angles; directions into which these are collected, about 15 degrees apart.
_NODES, _RAYS, _SOURCES = 7, 1536, 96
# A source with less than this share of the light is left out.
_LEAST = 0.002
# What follows the name of an image where it shows ground in the shade.
_IN_SHADE = " in shade"
# Rays begin so far above the ground, radii of the grid.
_ABOVE = 1e-4


@dataclass(frozen=True, eq=False)
class SecondaryLight:
    """Lit ground around a grid, as K distant sources of light.

    Parameters
    ----------
    grid : MapletGrid
        Few points over the same square.
    directions : (K, 3) ndarray
        Unit vectors from the ground to the sources, body-fixed.
    irradiance : (K, R, C) ndarray
        Of each source at each point, perpendicular to its direction: Φ of the lit ground times its
        solid angle. The sum over the sources has a mean of 1.
    """

    grid: MapletGrid
    directions: FloatArray
    irradiance: FloatArray

    def on_cells(self, grid: MapletGrid) -> tuple[FloatArray, FloatArray]:
        """Return directions (K, 3) along the axes of a grid, and irradiances of its cells.

        Parameters
        ----------
        grid : MapletGrid
            Of the same square and axes.

        Returns
        -------
        directions : (K, 3) ndarray
        irradiance : (K, R − 1, C − 1) ndarray
        """
        middle = (grid.offsets[1:] - 0.5) * (grid.gsd / self.grid.gsd)
        x, y = np.meshgrid(middle, middle)
        layers = [self.grid.interpolated(layer, x, y) for layer in self.irradiance]
        return self.directions @ grid.axes.T, np.stack(layers)

    def turned(self) -> Self:
        """Return the same light from the other side: turned by half a turn about Uz."""
        axes = self.grid.axes
        turn = axes.T @ np.diag([-1.0, -1.0, 1.0]) @ axes
        return replace(self, directions=self.directions @ turn)


def name_in_shade(image: str) -> str:
    """Return what an image is called where it shows ground in the shade.

    Parameters
    ----------
    image : str
    """
    return image + _IN_SHADE


def name_of_image(name: str) -> str | None:
    """Return the image of a name of :func:`name_in_shade`; None if it is not one.

    Parameters
    ----------
    name : str
    """
    return name.removesuffix(_IN_SHADE) if name.endswith(_IN_SHADE) else None


def image_in_shade(image: SpcImage) -> SpcImage:
    """Return an image of which only pixels below the threshold for shade count.

    Parameters
    ----------
    image : SpcImage
    """
    return replace(image, name=name_in_shade(image.name), thresholds=(0, image.thresholds[0]))


def secondary_light(
    ground: Maplet, image: SpcImage, shape: RayCaster, function: PhotometricFunction
) -> SecondaryLight | None:
    """Return the light from lit ground on a grid in an image; None where no point is in the shade.

    From a few places of the grid on the shape rays go out over the half of the sky above it. Where
    one meets ground that the Sun reaches, it brings the brightness of that ground [16]. Albedo is
    the same everywhere, and light that is reflected more than once is left out.

    Parameters
    ----------
    ground : Maplet
        Its heights are used where the shape has none; NaN is interpolated.
    image : SpcImage
        Whose Sun it is.
    shape : RayCaster
        Of the whole body, body-fixed.
    function : PhotometricFunction
    """
    grid = ground.grid
    nodes = grid.with_gsd(2.0 * grid.half_size * grid.gsd / (_NODES - 1))
    start = _on_shape(ground, nodes, shape).reshape(-1, 3)
    sun = np.broadcast_to(image.sun, start.shape)
    shaded = shape.cast(start, sun).hit | (grid.uz @ image.sun <= 0.0)
    if not shaded.any():
        return None
    rays = _half_sphere(_RAYS) @ grid.axes
    origins = np.repeat(start, _RAYS, axis=0)
    along = np.tile(rays, (len(start), 1))
    bright = _brightness(shape.cast(origins, along), along, image.sun, shape, function)
    bright = bright.reshape(len(start), _RAYS)
    if not bright.any():
        return None
    source = _nearest(rays, _half_sphere(_SOURCES) @ grid.axes)
    return _collected(nodes, rays, bright, source)


def _on_shape(ground: Maplet, nodes: MapletGrid, shape: RayCaster) -> FloatArray:
    """Return points (R, C, 3) of a grid just above the shape."""
    height = shape_heights(shape, nodes, reach=nodes.radius)
    step = nodes.gsd / ground.grid.gsd
    x, y = np.meshgrid(nodes.offsets * step, nodes.offsets * step)
    own = ground.grid.interpolated(filled(ground.height), x, y)
    known = np.where(np.isfinite(height), height, own)
    return nodes.points(known + _ABOVE * nodes.radius)


def _half_sphere(count: int) -> FloatArray:
    """Return unit vectors (count, 3) over the upper half sphere, of equal solid angles."""
    number = np.arange(count) + 0.5
    up = number / count
    # The golden angle: no two of them are in line.
    around = np.pi * (3.0 - np.sqrt(5.0)) * number
    out = np.sqrt(1.0 - up**2)
    return np.stack([out * np.cos(around), out * np.sin(around), up], axis=-1)


def _brightness(
    hits: Hits, along: FloatArray, sun: FloatArray, shape: RayCaster, function: PhotometricFunction
) -> FloatArray:
    """Return the brightness (N,) of what rays (N, 3) meet: 0 of the sky and of the shade."""
    bright = np.zeros(len(hits))
    incidence, emission = hits.normals @ sun, -np.sum(hits.normals * along, axis=1)
    lit = np.flatnonzero((incidence > 0.0) & (emission > 0.0))
    above = hits.points[lit] + _ABOVE * hits.distance[lit, None] * hits.normals[lit]
    lit = lit[~shape.cast(above, np.broadcast_to(sun, above.shape)).hit]
    phase = np.arccos(np.clip(-along[lit] @ sun, -1.0, 1.0))
    bright[lit] = function(incidence[lit], emission[lit], phase)
    return bright


def _nearest(rays: FloatArray, directions: FloatArray) -> IntArray:
    """Return the number (N,) of the direction that is nearest to each ray."""
    found: IntArray = np.argmax(rays @ directions.T, axis=1)
    return found


def _collected(
    nodes: MapletGrid, rays: FloatArray, bright: FloatArray, source: IntArray
) -> SecondaryLight:
    """Return the light of rays (N, 3), with brightness (P, N) at the points, by their sources."""
    belongs = (source[:, None] == np.arange(_SOURCES)).astype(np.float64)
    irradiance = bright @ belongs
    total = irradiance.sum(axis=0)
    kept = total > _LEAST * total.sum()
    mean = (belongs * bright.sum(axis=0)[:, None]).T[kept] @ rays / total[kept, None]
    # A wide source brings less than a narrow one: its rays do not add up in length.
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    directions = mean / length
    irradiance = (irradiance[:, kept] * length[:, 0]).T.reshape(-1, *nodes.shape)
    return SecondaryLight(nodes, directions, irradiance / irradiance.sum(axis=0).mean())
