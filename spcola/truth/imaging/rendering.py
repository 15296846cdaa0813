"""Images of the truth body by a framing camera, rendered by ray tracing."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.ndimage import gaussian_filter

from spcola.arrays import AnyArray, BoolArray, FloatArray, read_only
from spcola.camera import SpcImage, ray
from spcola.errors import SettingsError
from spcola.photometry.functions import photometric_function
from spcola.truth.body import SurfacePoints, TruthBody

BIT_DEPTHS = (8, 12, 14, 16)
# Blocks of pixels, so that the rays of a thread are close together.
_BLOCK = 90
_LEAST_COS_EMISSION = 0.02
# Steps of the two-dimensional sequence of the plastic number (Roberts 2018): any number of its
# points fills a pixel evenly.
_STEP_X, _STEP_Y = 0.7548776662466927, 0.5698402909980532


@dataclass(frozen=True)
class ImageSettings:
    """Detector and exposure.

    Parameters
    ----------
    photometry : str
        Name in :data:`spcola.photometry.functions.PHOTOMETRIC_FUNCTIONS`.
    rays_per_pixel : int
        1 for its centre alone; more are spread evenly over the pixel.
    psf_sigma : float
        Sigma of a Gaussian point spread, pixels; 0 for none. The frame's edge is continued outward.
    bits : {8, 12, 14, 16}
        Depth of the numbers, the largest of which is ``2 ** bits − 1``; brighter pixels saturate.
    exposure_iof : float
        The I/F that gives the share `exposure_share` of the largest number.
    exposure_share : float
        Share of the largest number at `exposure_iof`.
    full_well : float
        Electrons at the largest number: the shot noise is their square root.
    read_noise : float
        Electrons, one standard deviation, in every pixel.
    noise : bool
        Whether there is any noise. Negative numbers are set to 0.

    Raises
    ------
    SettingsError
        If a value lies outside its range.
    """

    photometry: str = "lunar-lambert"
    rays_per_pixel: int = 1
    psf_sigma: float = 0.0
    bits: int = 14
    exposure_iof: float = 0.04
    exposure_share: float = 0.7
    full_well: float = 24_000.0
    read_noise: float = 20.0
    noise: bool = True

    def __post_init__(self) -> None:
        photometric_function(self.photometry)
        if self.bits not in BIT_DEPTHS:
            raise SettingsError(f"must be one of {BIT_DEPTHS}, not {self.bits}", "bits of images")
        if self.rays_per_pixel < 1:
            raise SettingsError(f"must be at least 1, not {self.rays_per_pixel}", "rays per pixel")
        if min(self.psf_sigma, self.read_noise) < 0:
            raise SettingsError("must not be negative", "point spread or read noise")
        if not (self.exposure_iof > 0 and 0 < self.exposure_share <= 1 and self.full_well > 0):
            raise SettingsError("I/F, share or full well out of range", "exposure")

    @property
    def largest(self) -> int:
        """The largest number of a pixel."""
        return int(2**self.bits - 1)

    @property
    def dn_per_iof(self) -> float:
        """Numbers for an I/F of 1."""
        return self.exposure_share * self.largest / self.exposure_iof


@dataclass(frozen=True, eq=False)
class Rendered:
    """An image with the geometry of each pixel.

    All arrays are (NLN, NPX). Geometry is that of the ray through the pixel's centre; NaN where
    it misses the body.

    Attributes
    ----------
    dn : ndarray of uint16 (uint8 for 8 bits)
        The image.
    iof : ndarray of float32
        I/F without noise, after the point spread; 0 outside the body.
    incidence, emission : ndarray of float32
        Angles from the surface normal, radians.
    distance : ndarray
        From the camera, metres.
    lit : ndarray of bool
        Whether the Sun is above the local horizon and not occluded.
    """

    dn: AnyArray
    iof: FloatArray
    incidence: FloatArray
    emission: FloatArray
    distance: FloatArray
    lit: BoolArray

    @property
    def hit(self) -> BoolArray:
        """Where (NLN, NPX) the body is in the pixel's centre."""
        return np.isfinite(self.distance)


class TracedSurface(Protocol):
    """A surface on which rays are cast."""

    def cast(self, origins: FloatArray, directions: FloatArray) -> SurfacePoints:
        """Return the first hits of rays from origins (3,) or (N, 3) along directions (N, 3)."""

    def occluded(self, points: FloatArray, toward: FloatArray) -> BoolArray:
        """Return whether ground stands in the way from points (N, 3) of it towards (3,)."""


class _Layers(NamedTuple):
    """The arrays of :class:`Rendered` without noise: of a frame, or of N rays."""

    iof: FloatArray
    incidence: FloatArray
    emission: FloatArray
    distance: FloatArray
    lit: BoolArray


class _Scene(NamedTuple):
    """Input of the rendering."""

    surface: TracedSurface
    body: TruthBody
    image: SpcImage
    settings: ImageSettings


def render_image(
    surface: TracedSurface,
    body: TruthBody,
    image: SpcImage,
    *,
    settings: ImageSettings | None = None,
    generator: np.random.Generator,
) -> Rendered:
    """Return a camera's image of the body.

    ``I/F = mean albedo · relative albedo · Φ``, 0 in cast shadow; then point spread, exposure,
    noise (shot noise as a Gaussian of the electrons' variance, and read noise), and whole numbers.

    Parameters
    ----------
    surface : TracedSurface
        Sampled from `body` (:class:`~spcola.truth.sampled.SampledSurface`), its spacing no larger
        than a pixel on the ground; or its mesh (:class:`~spcola.truth.solid.MeshSurface`).
    body : TruthBody
        Gives the albedo.
    image : SpcImage
        TRUE state in the body-fixed frame: camera with its distortion, place, axes, Sun.
    settings : ImageSettings, optional
    generator : numpy.random.Generator
        Generator of the noise; the same state gives the same image, whatever the number of threads.
    """
    settings = settings or ImageSettings()
    scene = _Scene(surface, body, image, settings)
    shape = (image.camera.height, image.camera.width)
    frame = _Layers(
        np.zeros(shape, dtype=np.float32),
        np.full(shape, np.nan, dtype=np.float32),
        np.full(shape, np.nan, dtype=np.float32),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.bool_),
    )
    blocks = [
        (slice(i, min(i + _BLOCK, shape[0])), slice(j, min(j + _BLOCK, shape[1])))
        for i in range(0, shape[0], _BLOCK)
        for j in range(0, shape[1], _BLOCK)
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda block: _render_block(scene, frame, block), blocks))
    iof = frame.iof
    if settings.psf_sigma > 0:
        iof = gaussian_filter(iof, settings.psf_sigma, mode="nearest")
    dn = expose(iof, settings, generator)
    arrays = (dn, iof, frame.incidence, frame.emission, frame.distance, frame.lit)
    return Rendered(*(read_only(array) for array in arrays))


def expose(iof: FloatArray, settings: ImageSettings, generator: np.random.Generator) -> AnyArray:
    """Return the numbers (NLN, NPX) of a detector for I/F (NLN, NPX)."""
    numbers = settings.dn_per_iof * iof
    if settings.noise:
        per_electron = settings.largest / settings.full_well
        variance = per_electron * numbers + (per_electron * settings.read_noise) ** 2
        numbers = numbers + np.sqrt(variance) * generator.standard_normal(
            iof.shape, dtype=np.float32
        )
    kind = np.uint8 if settings.bits == 8 else np.uint16
    return np.clip(np.rint(numbers), 0, settings.largest).astype(kind)


def _render_block(scene: _Scene, frame: _Layers, block: tuple[slice, slice]) -> None:
    """Fill a block of the frame: geometry of the centres, brightness of all rays."""
    lines, pixels = (1.0 + grid.ravel() for grid in np.mgrid[block].astype(np.float64))
    shape = (block[0].stop - block[0].start, block[1].stop - block[1].start)
    rays = _rays(scene.settings.rays_per_pixel)
    found = _look(scene, pixels, lines)
    if len(rays) > 1:
        seen = [_look(scene, pixels + aside, lines + down).iof for aside, down in rays]
        found = found._replace(iof=np.mean(seen, axis=0))
    for whole, part in zip(frame, found, strict=True):
        whole[block] = part.reshape(shape)


def _rays(count: int) -> FloatArray:
    """Return the places of rays in a pixel (count, 2), relative to its centre, of mean 0.

    The first points of the sequence are one-sided: 16 of them would shift an image by 0.1 pixel.
    """
    steps = np.arange(count)[:, None] * np.array([_STEP_X, _STEP_Y])
    places: FloatArray = (0.5 + steps) % 1.0 - 0.5
    return places - places.mean(axis=0)


def _look(scene: _Scene, pixels: FloatArray, lines: FloatArray) -> _Layers:
    """Return the intersections of the rays through pixels and lines (N,)."""
    surface, body, image, settings = scene
    beams = ray(image, pixels, lines)
    hits = surface.cast(image.position, beams)
    cos_incidence = hits.normals @ image.sun
    cos_emission = -np.einsum("ij,ij->i", hits.normals, beams)
    lit = cos_incidence > 0.0
    where = np.flatnonzero(lit)
    shadow = surface.occluded(hits.points[where], image.sun)
    where = where[~shadow]
    lit[:] = False
    lit[where] = True
    iof = np.zeros(len(beams))
    phase = np.arccos(np.clip(-beams[where] @ image.sun, -1.0, 1.0))
    # A hit faces the camera, whatever the normal smoothed over cells is.
    facing = np.maximum(cos_emission[where], _LEAST_COS_EMISSION)
    shading = photometric_function(settings.photometry)(cos_incidence[where], facing, phase)
    iof[where] = body.settings.mean_albedo * body.albedo(hits.points[where]) * shading
    incidence, emission = (np.arccos(np.clip(c, -1, 1)) for c in (cos_incidence, cos_emission))
    return _Layers(iof, incidence, emission, hits.distance, lit)
