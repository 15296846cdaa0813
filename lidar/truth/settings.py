"""Properties of the scans of a synthetic mission, and the sizes of their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from spcola.errors import SettingsError

NO_ECHO_RANGE = -1.12892
"""Range, metres, in OLA's tables for shots without an echo."""
VALID, OVERFLOW, NO_RETURN, MISSING = 0, 1, 2, 3
"""Values of the flag in OLA's tables."""
DEMODULATOR = 100
"""Added to the flag while the demodulator is on."""

_SIGMAS = ("range_sigma", "slope_noise", "trajectory_sigma", "pointing_sigma", "intensity_noise")
_SHARES = ("stray_share", "dropout_share", "overflow_share", "missing_share")
# A raster of 1e10 shots: the number of a mission in years.
_MOST_LINES = 100_000


@dataclass(frozen=True)
class LidarSettings:
    """Properties of the scans; the error levels are those published for Bennu.

    Parameters
    ----------
    width : float
        Width of the square raster on the ground, metres.
    spacing : float
        Distance between neighbouring shots and lines of a raster, metres.
    range_sigma : float
        Of a single return at normal incidence, metres (1 σ).
    divergence : float
        Full width of the beam to 1/e², radians: twice a beam of 100 µrad, for distances of some
        750 m. The footprint's standard deviation is a quarter of that times the distance.
    slope_noise : float
        Share of the depth that the footprint spans on sloping ground, its standard deviation
        times the tangent of the incidence, which is added (in squares) to `range_sigma`.
    subrays : int
        Rays over the footprint whose mean is the range; 1: the axis of the beam alone.
    dropout_share : float
        Share of the shots without echo, at normal incidence.
    grazing_deg : float
        Beyond this incidence more and more echoes are lost, at 90° all.
    stray_share, stray_reach : float
        Share of the returns with a random range: outliers up to `stray_reach` before and behind
        the surface, metres.
    overflow_share, missing_share : float
        Shares of the shots flagged as overflow, and never recorded.
    intensity_noise : float
        Relative noise of the strength of each echo (1 σ).
    trajectory_sigma : float
        Of each scan's error of the spacecraft position, for each axis, metres.
    pointing_sigma : float
        Of each scan's error of pointing, on the ground, for each direction, metres.
    range_bias : float
        Error of all ranges, positive if they are too long, metres.
    reference_offset : float
        Distance from spacecraft to surface less the range in the tables, metres.
    demodulator : bool
        Whether the passes of odd number have the demodulator on.
    """

    width: float = 100.0
    spacing: float = 0.07
    range_sigma: float = 0.03
    divergence: float = 2.0e-4
    slope_noise: float = 0.5
    subrays: int = 1
    dropout_share: float = 0.01
    grazing_deg: float = 60.0
    stray_share: float = 0.005
    stray_reach: float = 30.0
    overflow_share: float = 0.0005
    missing_share: float = 0.0005
    intensity_noise: float = 0.05
    trajectory_sigma: float = 0.05
    pointing_sigma: float = 0.05
    range_bias: float = 0.0
    reference_offset: float = 1.1
    demodulator: bool = True

    def __post_init__(self) -> None:
        if not 0 < 2 * self.spacing <= self.width < np.inf:
            raise SettingsError("needs a width of two spacings at least, metres", "scans")
        if self.width > _MOST_LINES * self.spacing:
            raise SettingsError(f"has more than {_MOST_LINES} lines: spacing too small", "scans")
        if not all(0 <= getattr(self, name) < np.inf for name in _SIGMAS):
            raise SettingsError("must not be negative", "error levels of the scans")
        shares = [getattr(self, name) for name in _SHARES]
        if min(shares) < 0 or sum(shares) >= 1:
            raise SettingsError("shares of outliers and lost shots must sum to below 1", "scans")
        if self.subrays < 1 or not 0 <= self.divergence < 0.1:
            raise SettingsError("needs a ray, and a divergence of 0 … 0.1 rad", "beam")
        if not 0 < self.grazing_deg < 90 or self.stray_reach < 0:
            raise SettingsError("grazing incidence or reach of outliers out of range", "scans")

    @classmethod
    def exact(cls, width: float, spacing: float) -> LidarSettings:
        """Return settings of scans without any error or loss of single shots.

        `width` of the raster and `spacing` of its shots are metres on the ground.
        """
        none: dict[str, Any] = dict.fromkeys((*_SIGMAS, *_SHARES), 0.0)
        return cls(width=width, spacing=spacing, grazing_deg=89.999, **none)

    @property
    def lines(self) -> int:
        """Lines of a raster, and shots of a line."""
        return max(2, round(self.width / self.spacing))

    @property
    def shots(self) -> int:
        """Shots of a raster."""
        return self.lines**2

    @property
    def expected_share(self) -> float:
        """Share of the shots that become returns on ground that is not steep."""
        return 1.0 - self.dropout_share - self.overflow_share - self.missing_share


@dataclass(frozen=True)
class ScanErrors:
    """Errors of a whole scan.

    Attributes
    ----------
    offset_m : tuple of 3 float
        Stated minus true position of the spacecraft, body-fixed.
    pointing_m : tuple of 2 float
        Error of pointing on the ground, along and across the raster's lines.
    range_scale : float
        Stated ranges are true ones times 1 + this (the bias of a day).
    range_bias_m : float
        Constant added to stated ranges.
    """

    offset_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    pointing_m: tuple[float, ...] = (0.0, 0.0)
    range_scale: float = 0.0
    range_bias_m: float = 0.0

    @classmethod
    def drawn(
        cls, settings: LidarSettings, generator: np.random.Generator, *, range_scale: float = 0.0
    ) -> ScanErrors:
        """Draw the errors of one scan by `generator`, of the sizes that `settings` state.

        `range_scale` is the relative bias of the ranges of its day.
        """
        offset = settings.trajectory_sigma * generator.normal(size=3)
        pointing = settings.pointing_sigma * generator.normal(size=2)
        bias = settings.range_bias
        return cls(tuple(offset.tolist()), tuple(pointing.tolist()), range_scale, bias)
