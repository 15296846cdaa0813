"""Stars of a catalogue, and the directions in which a moving camera sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import FloatArray, check_finite, frozen
from spcola.errors import InvalidValueError

SPEED_OF_LIGHT = 299_792_458.0
"""m/s."""


@dataclass(frozen=True, eq=False)
class StarCatalogue:
    """Directions and magnitudes of stars.

    Parameters
    ----------
    directions : (N, 3) array_like
        Unit vectors, inertial, at the epoch of the images (no proper motion is applied).
    magnitudes : (N,) array_like

    Raises
    ------
    InvalidValueError
        If there is no star, a value is not finite, or a direction is no unit vector.
    """

    directions: FloatArray
    magnitudes: FloatArray

    def __post_init__(self) -> None:
        magnitudes = frozen(self.magnitudes, (None,), "catalogue: magnitudes")
        directions = frozen(self.directions, (len(magnitudes), 3), "catalogue: directions")
        object.__setattr__(self, "magnitudes", magnitudes)
        object.__setattr__(self, "directions", directions)
        for name, array in (("directions", directions), ("magnitudes", magnitudes)):
            check_finite(array, f"catalogue: {name}")
        if not len(magnitudes):
            raise InvalidValueError("has no star", "catalogue")
        if np.max(np.abs(np.linalg.norm(directions, axis=1) - 1.0)) > 1e-9:
            raise InvalidValueError("has a direction that is no unit vector", "catalogue")

    @classmethod
    def from_angles(
        cls, right_ascension: ArrayLike, declination: ArrayLike, magnitudes: ArrayLike
    ) -> StarCatalogue:
        """Build from angles.

        Parameters
        ----------
        right_ascension, declination : (N,) array_like
            Radians.
        magnitudes : (N,) array_like
        """
        ra, dec = np.asarray(right_ascension, float), np.asarray(declination, float)
        directions = [np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]
        return cls(np.stack(directions, axis=-1), np.asarray(magnitudes, float))


def apparent_directions(directions: ArrayLike, velocity: ArrayLike) -> FloatArray:
    """Return unit vectors (N, 3) as a moving camera sees them: stellar aberration.

    Special relativity: ``u' ∝ u/γ + β (1 + β·u γ/(γ+1))`` (Urban & Seidelmann, 2013, eq. 7.40). An
    orbit about the Sun moves a star by 20″, and changes angles by 1e-4: a focal length solved
    without it is wrong by as much.

    Parameters
    ----------
    directions : (N, 3) array_like
        Unit vectors to the stars from the solar system's barycentre, inertial.
    velocity : (3,) array_like
        Of the camera relative to the barycentre, same frame, m/s.

    Raises
    ------
    InvalidValueError
        If the speed is above a hundredth of light's: km/s were given as m/s, or worse.
    """
    unit = np.asarray(directions, dtype=np.float64)
    beta = np.asarray(velocity, dtype=np.float64) / SPEED_OF_LIGHT
    speed = float(np.linalg.norm(beta))
    if not speed < 0.01:
        raise InvalidValueError(f"is {speed * SPEED_OF_LIGHT:.3g} m/s, no spacecraft's", "velocity")
    gamma = 1.0 / np.sqrt(1.0 - speed**2)
    along = 1.0 + (unit @ beta) * gamma / (gamma + 1.0)
    seen = unit / gamma + along[..., None] * beta
    found: FloatArray = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    return found
