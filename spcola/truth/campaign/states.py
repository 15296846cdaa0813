"""States of the synthetic images: the true one, the SPC solution's, and navigation's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import FloatArray
from spcola.camera import SpcImage, rotate_axes
from spcola.errors import SettingsError
from spcola.math import Similarity
from spcola.navigation import NominalState, utc_from_et
from spcola.truth.campaign.cameras import looking, turned_to
from spcola.truth.campaign.stations import Station

__all__ = ["SolvedState", "StateSettings", "capped_deviation", "make_state", "true_state"]


@dataclass(frozen=True)
class StateSettings:
    """Error levels of the states.

    Parameters
    ----------
    per_pass : int
        Images of a pass, from its first to its last moment.
    position_sigma : float
        Sigma of solved positions, for each axis, metres.
    pixel_sigma : float
        Sigma of the measured pixel and line of landmarks.
    nominal_pointing_sigma : float
        Sigma of nominal pointing, about each camera axis, radians.
    most_emission_deg, most_incidence_deg : float
        Beyond these angles from the maplet's normal a landmark is not measured, or too dark.
    coarsest : float
        Largest size of a pixel, in GSDs of a maplet, at which an image measures it.
    distortion : tuple of 4 float
        Distortion of the cameras, by Owen's model (:mod:`spcola.camera.distortion`): images are
        rendered with it, and the solution uses it.
    """

    per_pass: int = 3
    position_sigma: float = 0.20
    pixel_sigma: float = 0.3
    nominal_pointing_sigma: float = 1.0e-4
    most_emission_deg: float = 65.0
    most_incidence_deg: float = 80.0
    coarsest: float = 1.5
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.per_pass < 1:
            raise SettingsError(f"must be at least 1, not {self.per_pass}", "images of a pass")
        sigmas = (self.position_sigma, self.pixel_sigma, self.nominal_pointing_sigma)
        if min(sigmas) < 0:
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
        In the body frame; the image is rendered with it.
    solved : SpcImage
        State of the SPC solution, in its frame.
    nominal : NominalState
        A-priori state of navigation, in the frame of the solution.
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

    The solved position has an error of the settings' sigma on each axis. The solved axes point from
    there to the same ground, by the smallest rotation: the solution has turned them until its
    landmarks fit, so that errors of position and pointing are correlated, and the stated sigma of
    pointing is that at a known position.

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
        Depth of the image: its thresholds lie above the noise and below saturation.
    """
    truth = true_state(station, sun, settings, bits)
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
    deviation = station.nominal_sigma * capped_deviation(generator)
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


def true_state(
    station: Station, sun: FloatArray, settings: StateSettings, bits: int = 16
) -> SpcImage:
    """Return the true state of an image in the body frame, without pixels.

    Parameters
    ----------
    station : Station
    sun : (3,) ndarray
        Unit vector to the Sun, in the body frame.
    settings : StateSettings
        Only the distortion is used.
    bits : int
        Depth of the image.
    """
    return SpcImage(
        name=station.name,
        utc=utc_from_et(station.time),
        camera=replace(station.camera, distortion=np.array(settings.distortion)),
        scobj=-station.position,
        axes=looking(station.position, station.target),
        sun=sun,
        thresholds=(2**bits // 256, 2**bits - 2),
        scobj_sigma=np.zeros(3),
        pointing_sigma=np.zeros(3),
    )


def capped_deviation(generator: np.random.Generator) -> FloatArray:
    """Return a deviation (3,) with σ = 1 of its length: capped at 1, which a third reach.

    The paper's kernels were made like this: some 70 % lie within σ, and those beyond are set to it
    (Weirich et al., section 2.6).

    Parameters
    ----------
    generator : numpy.random.Generator
    """
    direction = generator.normal(size=3)
    distance = min(abs(float(generator.normal())), 1.0)
    return distance * direction / np.linalg.norm(direction)
