"""How a body turns: its pole and prime meridian, and what another statement of them changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError

SECONDS_PER_DAY = 86400.0


@dataclass(frozen=True)
class Spin:
    """A uniform rotation, as IAU reports and SPICE's text kernels state it.

    Parameters
    ----------
    pole_ra_deg, pole_dec_deg : float
        Right ascension and declination of the pole in J2000, degrees.
    meridian_deg : float
        W₀: angle of the prime meridian at J2000 (TDB), degrees.
    rate_deg_per_day : float
        Ẇ, degrees per day of 86400 s.

    Raises
    ------
    InvalidValueError
        If a number is not finite, or the declination lies beyond a pole.
    """

    pole_ra_deg: float
    pole_dec_deg: float
    meridian_deg: float
    rate_deg_per_day: float

    def __post_init__(self) -> None:
        numbers = (
            self.pole_ra_deg,
            self.pole_dec_deg,
            self.meridian_deg,
            self.rate_deg_per_day,
        )
        if not np.isfinite(numbers).all():
            raise InvalidValueError("has a number that is not finite", "spin")
        if abs(self.pole_dec_deg) > 90.0:
            raise InvalidValueError(f"{self.pole_dec_deg:g} is no declination", "spin")

    @property
    def rate(self) -> float:
        """Radians per second."""
        return float(np.radians(self.rate_deg_per_day) / SECONDS_PER_DAY)

    def axes(self, times: ArrayLike) -> FloatArray:
        """Return the body-fixed axes (N, 3, 3) in J2000 at ephemeris times (N,), s.

        Rows are X, Y, Z: the matrix takes J2000 to body-fixed coordinates,
        ``R_z(W) R_x(90° − δ) R_z(90° + α)`` (Archinal et al., IAU working group report).
        """
        wanted = np.asarray(times, dtype=np.float64)
        angles = np.empty((len(wanted), 3))
        # Days and degrees first: radians of years of rotation would lose digits.
        turned = (self.rate_deg_per_day * (wanted / SECONDS_PER_DAY)) % 360.0
        angles[:, 0] = 90.0 + self.pole_ra_deg
        angles[:, 1] = 90.0 - self.pole_dec_deg
        angles[:, 2] = self.meridian_deg + turned
        # Intrinsic rotations of the frame are the inverse of those of the vectors.
        frames = Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix()
        return np.swapaxes(frames, 1, 2)

    def change_to(self, corrected: Spin, times: ArrayLike) -> FloatArray:
        """Return rotation vectors (N, 3), radians: body-fixed coordinates by `self` to `corrected`.

        A corrected meridian turns about Z; a corrected pole about an axis in the equator that
        goes around with the spin, for the pole is corrected in the sky and not on the ground.
        """
        matrices = corrected.axes(times) @ np.swapaxes(self.axes(times), 1, 2)
        vectors: FloatArray = Rotation.from_matrix(matrices).as_rotvec()
        return vectors


def turned(vectors: FloatArray, points: FloatArray) -> FloatArray:
    """Turn points (N, 3) by rotation vectors (N, 3), radians, about the origin."""
    # Rotation.apply refuses arrays that may not be written, which those of values are.
    result: FloatArray = np.einsum("nij,nj->ni", Rotation.from_rotvec(vectors).as_matrix(), points)
    return result
