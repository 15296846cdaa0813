"""States of the synthetic images: the true one, the one SPC solved for, and navigation's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.image import ImagePoint, SpcImage
from spcola.landmark import Landmark, MapOverlap
from spcola.maplet import Maplet
from spcola.nominal import NominalState
from spcola.projection import project, rotate_axes
from spcola.similarity import Similarity
from spcola.time import utc_from_et
from spcola.truth.cameras import framing_camera, looking, turned_to
from spcola.truth.passes import Pass, PassSettings
from spcola.truth.stations import Station

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
    nominal_pointing_sigma : float
        Of nominal pointing, about each camera axis, radians.
    most_emission_deg, most_incidence_deg : float
        Beyond these angles from the maplet's normal a landmark is not measured, or too dark.
    coarsest : float
        An image of which a pixel covers more GSDs than this has nothing to say about a maplet.
    """

    per_pass: int = 3
    position_sigma: float = 0.20
    pixel_sigma: float = 0.3
    nominal_sigmas: tuple[float, float, float] = (6.4, 6.4, 6.4)
    nominal_pointing_sigma: float = 1.0e-4
    most_emission_deg: float = 65.0
    most_incidence_deg: float = 80.0
    coarsest: float = 1.5

    def __post_init__(self) -> None:
        if self.per_pass < 1:
            raise SettingsError(f"must be at least 1, not {self.per_pass}", "images of a pass")
        sigmas = (self.position_sigma, self.pixel_sigma, self.nominal_pointing_sigma)
        if min(*sigmas, *self.nominal_sigmas) < 0:
            raise SettingsError("must not be negative", "error levels of the states")
        angles = (self.most_emission_deg, self.most_incidence_deg)
        if not (0 < min(angles) <= max(angles) <= 90 and self.coarsest > 0):
            raise SettingsError("angles or coarsest pixel out of range", "landmarks")


@dataclass(frozen=True, eq=False)
class SolvedState:
    """One image in three states.

    Attributes
    ----------
    truth : SpcImage
        In the body frame; with it the image is rendered.
    solved : SpcImage
        As the SPC solution has it, in its frame.
    nominal : NominalState
        As navigation had it before, in the frame of the solution.
    """

    truth: SpcImage
    solved: SpcImage
    nominal: NominalState


def make_state(
    station: Station,
    to_spc: Similarity,
    sun: FloatArray,
    *,
    settings: StateSettings,
    generator: np.random.Generator,
    bits: int = 16,
) -> SolvedState:
    """Return the states of an image.

    The solved place is off by the settings' sigma on each axis. The solved axes look from there at
    the same ground, by the smallest turn: the solution has turned them until its landmarks fit, so
    that errors of position and pointing go together, and the stated sigma of pointing is what is
    left of it at a known place.

    Parameters
    ----------
    station : Station
    to_spc : Similarity
        Planted similarity, from the body frame to that of the solution.
    sun : (3,) ndarray
        Unit vector to the Sun, in the body frame.
    settings : StateSettings
    generator : numpy.random.Generator
    bits : int
        Depth of the image: of its brightness, what is above the noise and below saturation counts.
    """
    truth = SpcImage(
        name=station.name,
        utc=utc_from_et(station.time),
        camera=station.camera,
        scobj=-station.position,
        axes=looking(station.position, station.target),
        sun=sun,
        thresholds=(2**bits // 256, 2**bits - 2),
        scobj_sigma=np.zeros(3),
        pointing_sigma=np.zeros(3),
    )
    position = to_spc.apply(station.position)
    wrong = position + settings.position_sigma * generator.normal(size=3)
    axes = to_spc.turn(truth.axes)
    sight = to_spc.apply(station.target) - wrong
    solved = replace(
        truth,
        scobj=-wrong,
        axes=turned_to(axes, sight / np.linalg.norm(sight)),
        sun=to_spc.turn(sun),
        scobj_sigma=np.full(3, settings.position_sigma),
        pointing_sigma=np.full(3, settings.pixel_sigma * station.camera.pixel_angle),
    )
    deviation = station.nominal_sigma * _capped_deviation(generator)
    turns = settings.nominal_pointing_sigma * generator.normal(size=3)
    nominal = NominalState(
        station.name,
        to_spc.scale * to_spc.turn(station.velocity),
        -(position + deviation),
        rotate_axes(axes, turns),
        scobj_sigma=np.full(3, station.nominal_sigma),
        pointing_sigma=np.full(3, settings.nominal_pointing_sigma),
    )
    return SolvedState(truth, solved, nominal)


def _capped_deviation(generator: np.random.Generator) -> FloatArray:
    """Return a deviation (3,) of σ = 1 as a distance: none further than 1, a third just there.

    So the paper's kernels were made: some 70 % lie within σ, and what lies beyond is set to it
    (Weirich et al., section 2.6).
    """
    direction = generator.normal(size=3)
    distance = min(abs(float(generator.normal())), 1.0)
    return distance * direction / np.linalg.norm(direction)


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
        camera = framing_camera("PolyCam" if 2 * number + 1 == settings.per_pass else "MapCam")
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
