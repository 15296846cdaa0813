"""When and from where a synthetic spacecraft looks at the synthetic body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.time import utc_from_et
from spcola.truth.solution import lattice

_DAY = 86400.0
_MONTHS = "JANFEBMARAPRMAYJUNJULAUGSEPOCTNOVDEC"


@dataclass(frozen=True)
class PassSettings:
    """How the observations are spread over days, local times and the body.

    Parameters
    ----------
    count : int
        Number of passes; their directions are spread evenly over the sphere.
    days : int
        Days that they are dealt to.
    local_times_h : tuple of float
        Local solar time under the spacecraft, one for each day in turn, hours.
    nearest, farthest : float
        Distances from O between which the passes lie, metres.
    duration : float
        Of a pass, seconds.
    period : float
        Of the body's rotation, seconds.
    sun_latitude_deg : float
        Of the sub-solar point: small, so that a pole stays dark.
    epoch : float
        Ephemeris time at which the first day begins, s (2019 JUL 01 00:00 UTC).
    """

    count: int = 20
    days: int = 5
    local_times_h: tuple[float, ...] = (9.5, 11.0, 12.5, 14.0, 15.5)
    nearest: float = 3000.0
    farthest: float = 4000.0
    duration: float = 300.0
    period: float = 4.296 * 3600.0
    sun_latitude_deg: float = 2.0
    epoch: float = 615_211_269.184

    def __post_init__(self) -> None:
        if self.count < 4 or self.days < 1 or not self.local_times_h:
            raise SettingsError("needs four passes, a day and a local time at least", "passes")
        if not (0 < self.nearest <= self.farthest and 0 < self.duration < self.period):
            raise SettingsError("distances, duration or period out of range", "passes")

    def sun(self, time: float) -> FloatArray:
        """Return the unit vector (3,) to the Sun, body-fixed, at ephemeris time `time`, s."""
        return _direction(self.sun_longitude(time), np.radians(self.sun_latitude_deg))

    def sun_longitude(self, time: float) -> float:
        """Return the longitude of the sub-solar point, radians: 0 at the epoch."""
        return float(-2.0 * np.pi * (time - self.epoch) / self.period)


@dataclass(frozen=True)
class Pass:
    """One pass: the spacecraft stands still in space while the body turns under it.

    Attributes
    ----------
    number : int
        From 1, in order of time.
    start, duration, period : float
        Seconds; the start is ephemeris time. The period is the body's rotation.
    longitude, latitude : float
        Of the spacecraft at the middle of the pass, body-fixed, radians.
    distance : float
        From O, metres.
    """

    number: int
    start: float
    duration: float
    period: float
    longitude: float
    latitude: float
    distance: float

    @property
    def middle(self) -> float:
        """Ephemeris time of the middle, s."""
        return self.start + self.duration / 2.0

    @property
    def day(self) -> str:
        """UTC date of the middle, ``YYYY-MM-DD``."""
        year, month, day = utc_from_et(self.middle).split()[:3]
        return f"{year}-{_MONTHS.index(month) // 3 + 1:02d}-{day}"

    def position(self, time: FloatArray) -> FloatArray:
        """Return true positions (N, 3), metres, body-fixed, at times (N,), s."""
        turned = 2.0 * np.pi * (np.asarray(time) - self.middle) / self.period
        return self.distance * _direction(self.longitude - turned, self.latitude)

    def velocity(self, time: FloatArray) -> FloatArray:
        """Return the rate (N, 3), m/s, of the body-fixed position."""
        position = self.position(time)
        rate = 2.0 * np.pi / self.period
        zero = np.zeros_like(position[..., 0])
        return rate * np.stack([position[..., 1], -position[..., 0], zero], axis=-1)


def plan_passes(settings: PassSettings, generator: np.random.Generator) -> list[Pass]:
    """Return the passes in order of time.

    The directions are dealt to the days in turn; within a day each takes the first moment, after
    the one before, at which the body shows the wanted longitude at the day's local time.
    """
    directions = lattice(settings.count)
    distances = generator.uniform(settings.nearest, settings.farthest, size=settings.count)
    passes: list[Pass] = []
    for day in range(settings.days):
        free = settings.epoch + day * _DAY
        local_time_h = settings.local_times_h[day % len(settings.local_times_h)]
        for k in range(day, settings.count, settings.days):
            x, y, z = directions[k]
            longitude, latitude = float(np.arctan2(y, x)), float(np.arcsin(z))
            noon = longitude - np.radians(15.0 * (local_time_h - 12.0))
            phase = (settings.sun_longitude(free + settings.duration / 2.0) - noon) / (2.0 * np.pi)
            start = free + (phase % 1.0) * settings.period
            free = start + settings.duration
            passes.append(
                Pass(
                    len(passes) + 1, start, settings.duration, settings.period,
                    longitude, latitude, float(distances[k]),
                )
            )  # fmt: skip
    return passes


def _direction(longitude: float | FloatArray, latitude: float) -> FloatArray:
    """Return unit vectors (…, 3) of longitudes (…) at one latitude, radians."""
    ring = np.cos(latitude)
    z = np.full(np.shape(longitude), np.sin(latitude))
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=-1)
