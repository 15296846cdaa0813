"""Settings of the synthetic body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.errors import SettingsError
from spcola.truth.body.relief import PowerLaw, SmoothSite

# Roughness at wavelengths beyond this share of the radius would only displace the body.
_LONGEST_SHARE = 0.63


def _even(density_per_km2: float, slope: float, smallest: float, largest: float) -> PowerLaw:
    return PowerLaw(density_per_km2, slope, smallest, largest, contrast=0.0)


@dataclass(frozen=True)
class BodySettings:
    """Properties of the body; the defaults are the synthetic Bennu's of Weirich et al.

    Parameters
    ----------
    seed : int
        The same seed and settings give the same body on every machine; 0 or more.
    radius : float
        Mean radius of the smooth shape, metres.
    shape : float
        1 for a spinning top, 0 for a sphere: factor of the low-degree coefficients.
    roughness : float
        Rms of the roughness at a wavelength of 4 m, metres; 0 for none.
    roughness_exponent : float
        The rms grows with this power of the wavelength.
    longest, shortest : float
        Wavelengths between which the body is rough, metres (by halves from the longest, those
        beyond 0.63 radii left out). The albedo varies down to 1 m, or to the shortest if less.
    roughness_contrast : float
        The amplitude goes as ``1 + contrast · (y² − x²)`` of the direction: greatest at 90° and
        270° of longitude (Weirich et al., section 2.4).
    craters, boulders : PowerLaw
        Numbers: on a square kilometre ``1e4 · D ** -2.9`` craters and ``1e4 · D ** -2.7``
        boulders larger than D metres (Weirich et al., section 2.4).
    smallest_rock : float, optional
        Rocks by the law of the boulders down to this diameter, metres (by halves from their
        smallest; 0.05 in Weirich et al.). None for no rocks: they double the time of every query.
    site : SmoothSite, optional
        Smooth area; None for none.
    albedo : float
        Rms of the relative albedo about 1, without the spots.
    mean_albedo : float
        The albedo itself, where the relative one is 1.
    spots : PowerLaw
        Number of isolated spots.
    bright, dark : float
        Relative albedo added by the brightest and the darkest spot.

    Raises
    ------
    SettingsError
        If a number lies outside its range.
    """

    seed: int = 1
    radius: float = 245.0
    shape: float = 1.0
    roughness: float = 0.05
    roughness_exponent: float = 0.9
    longest: float = 153.6
    shortest: float = 1.2
    roughness_contrast: float = 0.4
    craters: PowerLaw = field(default_factory=lambda: PowerLaw(1.0e4, 2.9, 1.5, 60.0))
    boulders: PowerLaw = field(default_factory=lambda: PowerLaw(1.0e4, 2.7, 0.4, 10.0))
    smallest_rock: float | None = None
    site: SmoothSite | None = field(default_factory=SmoothSite)
    albedo: float = 0.04
    mean_albedo: float = 0.04
    spots: PowerLaw = field(default_factory=lambda: _even(300.0, 2.0, 1.5, 15.0))
    bright: float = 0.5
    dark: float = -0.3

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise SettingsError(f"must be at least 0, not {self.seed}", "seed")
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise SettingsError(f"must be positive, not {self.radius} m", "radius")
        if self.roughness < 0 or not 0 < self.shortest <= self.longest:
            raise SettingsError("must be ≥ 0 over wavelengths 0 < shortest ≤ longest", "roughness")
        if self.smallest_rock is not None and not self.smallest_rock >= 0.01:
            raise SettingsError(f"must be at least 0.01, not {self.smallest_rock} m", "rocks")
        if not 0 <= self.roughness_contrast < 1:
            raise SettingsError("must lie in 0 … 1", "roughness_contrast")
        if not 0 <= self.albedo < 0.2 or not 0 < self.mean_albedo <= 1:
            raise SettingsError("must lie in 0 … 0.2, the mean in 0 … 1", "albedo")
        if not (-0.8 <= self.dark <= 0 <= self.bright):
            raise SettingsError("must be -0.8 ≤ dark ≤ 0 ≤ bright", "spots")

    @classmethod
    def sphere(cls, radius: float = 75.0) -> BodySettings:
        """Return settings of a smooth sphere (`radius` in metres) of even albedo."""
        none = _even(0.0, 2.7, 1.0, 2.0)
        return cls(
            0, radius, shape=0.0, roughness=0.0, craters=none, boulders=none, site=None,
            albedo=0.0, spots=none,
        )  # fmt: skip

    @property
    def longest_used(self) -> float:
        """The longest wavelength at which this body is rough, metres."""
        over = max(0.0, np.ceil(np.log2(self.longest / (_LONGEST_SHARE * self.radius))))
        return self.longest / 2.0**over
