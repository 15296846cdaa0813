"""Images of the synthetic body as states: where SPC puts the spacecraft, and what it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import Camera
from spcola.errors import SettingsError
from spcola.image import ImagePoint, SpcImage
from spcola.landmark import Landmark, MapOverlap
from spcola.maplet import Maplet
from spcola.nominal import NominalState
from spcola.projection import project
from spcola.similarity import Similarity
from spcola.time import utc_from_et
from spcola.truth.passes import Pass, PassSettings

_PIXELS_PER_MM = 1.0 / 0.0085
# Beyond these angles from the normal a landmark is not measured, or too dark.
_MOST_EMISSION_DEG = 65.0
_MOST_INCIDENCE_DEG = 80.0


@dataclass(frozen=True)
class StateSettings:
    """Error levels of the states.

    Parameters
    ----------
    per_pass : int
        Images of a pass, from its first to its last moment, so that they span it.
    position_sigma : float
        Of solved positions, for each axis, metres.
    pixel_sigma : float
        Of the measured pixel and line of landmarks.
    nominal_sigmas : tuple of 3 float
        Of nominal positions, for each axis, metres: each deviation is capped at 1 σ
        (Weirich et al., section 3).
    """

    per_pass: int = 3
    position_sigma: float = 0.20
    pixel_sigma: float = 0.3
    nominal_sigmas: tuple[float, float, float] = (6.4, 6.4, 6.4)

    def __post_init__(self) -> None:
        if self.per_pass < 1:
            raise SettingsError(f"must be at least 1, not {self.per_pass}", "images of a pass")
        if min(self.position_sigma, self.pixel_sigma, *self.nominal_sigmas) < 0:
            raise SettingsError("must not be negative", "error levels of the states")


def mapping_camera() -> Camera:
    """Return a framing camera like MapCam: 125 mm, 68 µrad pixels, 1024²."""
    return _camera(125.2)


def narrow_camera() -> Camera:
    """Return a framing camera like PolyCam: 629 mm, 13.5 µrad pixels, 1024²."""
    return _camera(628.9)


def _camera(focal_length_mm: float) -> Camera:
    k_matrix = [[_PIXELS_PER_MM, 0.0, 0.0], [0.0, _PIXELS_PER_MM, 0.0]]
    return Camera(focal_length_mm, np.full(2, 512.5), np.array(k_matrix), 1024, 1024)


def looking(position: FloatArray, target: FloatArray) -> FloatArray:
    """Return camera axes (3, 3), body-fixed, at `position` with the boresight to `target`.

    Cx lies in the body's equatorial plane.
    """
    cz = (target - position) / np.linalg.norm(target - position)
    cx = np.cross(cz, [0.0, 0.0, 1.0])
    cx /= np.linalg.norm(cx)
    return np.stack([cx, np.cross(cz, cx), cz])


def make_states(
    at: Pass,
    passes: PassSettings,
    to_spc: Similarity,
    *,
    settings: StateSettings,
    generator: np.random.Generator,
) -> list[tuple[SpcImage, NominalState]]:
    """Return solved and nominal states, in the frame of the solution, of the images of a pass.

    The middle image is a narrow one. Axes look at O from the (wrong) solved place: the solution
    has turned them until its landmarks fit, so that errors of position and pointing go together.
    """
    states = []
    for number, share in enumerate(np.linspace(0.02, 0.98, settings.per_pass)):
        # Times are kept as exact as a .SUM file writes them.
        time = round(at.start + share * at.duration, 3)
        camera = narrow_camera() if 2 * number + 1 == settings.per_pass else mapping_camera()
        true_position = to_spc.apply(at.position(np.array([time]))[0])
        position = true_position + settings.position_sigma * generator.normal(size=3)
        sigma = np.full(3, settings.position_sigma)
        image = SpcImage(
            name=f"P{at.number:02d}I{number + 1:02d}",
            utc=utc_from_et(time),
            camera=camera,
            scobj=-position,
            axes=looking(position, to_spc.translation),
            sun=to_spc.turn(passes.sun(time)),
            scobj_sigma=sigma,
            pointing_sigma=np.full(3, settings.pixel_sigma * camera.pixel_angle),
        )
        velocity = to_spc.scale * to_spc.turn(at.velocity(np.array([time]))[0])
        states.append((image, _nominal(image, true_position, velocity, settings, generator)))
    return states


def _nominal(
    image: SpcImage,
    true_position: FloatArray,
    velocity: FloatArray,
    settings: StateSettings,
    generator: np.random.Generator,
) -> NominalState:
    """Return the state as navigation would have had it."""
    sigma = np.array(settings.nominal_sigmas)
    position = true_position + sigma * np.clip(generator.normal(size=3), -1.0, 1.0)
    pointing = np.full(3, 5.0 * image.camera.pixel_angle)
    return NominalState(
        image.name, velocity, -position, image.axes, scobj_sigma=sigma, pointing_sigma=pointing
    )


def measure_landmarks(
    image: SpcImage, maplets: Sequence[Maplet], sigma: float, generator: np.random.Generator
) -> tuple[ImagePoint, ...]:
    """Return the landmarks that an image sees, where it sees them (noise of `sigma` pixels).

    Seen is a centre that lies in the frame and whose maplet faces both the camera and the Sun;
    that something higher might stand before it is not looked into.
    """
    centers = np.array([maplet.grid.center for maplet in maplets])
    normals = np.array([maplet.grid.uz for maplet in maplets])
    toward = image.position - centers
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    pixel, line = project(image.camera, image.axes, image.scobj, centers)
    measured = np.stack([pixel, line]) + sigma * generator.normal(size=(2, len(centers)))
    size = np.array([[image.camera.width], [image.camera.height]])
    seen = ((measured > 1.0) & (measured < size)).all(axis=0)
    seen &= np.sum(normals * toward, axis=1) > np.cos(np.radians(_MOST_EMISSION_DEG))
    seen &= normals @ image.sun > np.cos(np.radians(_MOST_INCIDENCE_DEG))
    # Two decimals, as the files hold them, so that .LMK and .SUM say the same.
    points = np.round(measured, 2)
    return tuple(
        ImagePoint(maplets[k].name, float(points[0, k]), float(points[1, k]))
        for k in np.flatnonzero(seen).tolist()
    )


def landmark_of(
    maplet: Maplet, maplets: Sequence[Maplet], images: Sequence[SpcImage], rms: float
) -> Landmark:
    """Return the landmark of a maplet: its pictures as `images` list them, and its overlaps."""
    pictures = tuple(
        ImagePoint(image.name, point.pixel, point.line)
        for image in images
        for point in image.landmarks
        if point.name == maplet.name
    )
    return Landmark(
        maplet.name,
        maplet.grid,
        sigma=maplet.center_sigma,
        prior_sigma=5.0,
        rms=rms,
        pictures=pictures,
        overlaps=_overlaps(maplet, maplets),
    )


def _overlaps(maplet: Maplet, maplets: Sequence[Maplet]) -> tuple[MapOverlap, ...]:
    """Return the maplets whose centre lies within this one's square, or not far outside."""
    found = []
    for other in maplets:
        x, y, height = maplet.grid.project(other.grid.center)
        near = max(abs(float(x)), abs(float(y))) < 1.5 * maplet.grid.half_size
        if other is not maplet and near and other.grid.uz @ maplet.grid.uz > 0.5:
            h = float(height) / maplet.grid.gsd
            found.append(MapOverlap(other.name, *(round(float(c), 2) for c in (x, y, h))))
    return tuple(found)
