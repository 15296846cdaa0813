"""Rotation of a body: pole and prime meridian, and the effect of correcting them."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError

_SECONDS_PER_DAY = 86400.0
_DAYS_PER_CENTURY = 36525.0


@dataclass(frozen=True)
class Spin:
    """A rotation as in IAU reports and SPICE's text kernels, without periodic terms.

    Days (of 86400 s) and Julian centuries count from J2000 (TDB). Nutation, precession and
    libration terms (``NUT_PREC_*``) are not included: they need SPICE kernels.

    Parameters
    ----------
    pole_ra_deg, pole_dec_deg : float
        Right ascension and declination of the pole in J2000, degrees.
    meridian_deg : float
        W₀: angle of the prime meridian at J2000, degrees.
    rate_deg_per_day : float
        W₁, degrees per day.
    quadratic_deg_per_day2 : float
        W₂: coefficient of the square of the days, half of the angular acceleration.
    pole_ra_rate_deg_per_century, pole_dec_rate_deg_per_century : float
        Motion of the pole.

    Raises
    ------
    InvalidValueError
        If a number is not finite, or the declination lies beyond a pole.
    """

    pole_ra_deg: float
    pole_dec_deg: float
    meridian_deg: float
    rate_deg_per_day: float
    quadratic_deg_per_day2: float = 0.0
    pole_ra_rate_deg_per_century: float = 0.0
    pole_dec_rate_deg_per_century: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(astuple(self)).all():
            raise InvalidValueError("has a number that is not finite", "spin")
        if abs(self.pole_dec_deg) > 90.0:
            raise InvalidValueError(f"{self.pole_dec_deg:g} is no declination", "spin")

    def rate(self, time: float) -> float:
        """Return the rate of rotation at ephemeris time, s: radians per second."""
        days = time / _SECONDS_PER_DAY
        per_day = self.rate_deg_per_day + 2.0 * self.quadratic_deg_per_day2 * days
        return float(np.radians(per_day) / _SECONDS_PER_DAY)

    def axes(self, times: ArrayLike) -> FloatArray:
        """Return the body-fixed axes (N, 3, 3) in J2000 at ephemeris times (N,), s.

        Rows are X, Y, Z: the matrix takes J2000 to body-fixed coordinates,
        ``R_z(W) R_x(90° − δ) R_z(90° + α)`` (Archinal et al., IAU working group report).
        """
        days = np.asarray(times, dtype=np.float64) / _SECONDS_PER_DAY
        centuries = days / _DAYS_PER_CENTURY
        angles = np.empty((len(days), 3))
        # Reduced in degrees first: radians of years of rotation would lose digits.
        turned = (self.rate_deg_per_day * days) % 360.0 + self.quadratic_deg_per_day2 * days**2
        angles[:, 0] = 90.0 + self.pole_ra_deg + self.pole_ra_rate_deg_per_century * centuries
        angles[:, 1] = 90.0 - self.pole_dec_deg - self.pole_dec_rate_deg_per_century * centuries
        angles[:, 2] = self.meridian_deg + turned
        # Intrinsic rotations of the frame are the inverse of those of the vectors.
        frames = Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix()
        return np.swapaxes(frames, 1, 2)

    def change_to(self, corrected: Spin, times: ArrayLike) -> FloatArray:
        """Return rotation vectors (N, 3), radians, from body-fixed coordinates to `corrected` ones.

        They belong to ephemeris times (`times`, (N,), s).

        A corrected meridian turns about Z; a corrected pole about an axis in the equator that
        rotates with the spin, since the pole is corrected in inertial space.
        """
        matrices = corrected.axes(times) @ np.swapaxes(self.axes(times), 1, 2)
        return Rotation.from_matrix(matrices).as_rotvec()

    def moved(self, points: FloatArray, corrected: Spin, times: ArrayLike) -> FloatArray:
        """Return body-fixed points (N, 3), located with this spin, as located with `corrected`.

        Each point belongs to one of the ephemeris times (N,), s.
        """
        change = Rotation.from_rotvec(self.change_to(corrected, times)).as_matrix()
        # Rotation.apply refuses read-only arrays, such as those of value objects.
        return np.einsum("nij,nj->ni", change, points)
