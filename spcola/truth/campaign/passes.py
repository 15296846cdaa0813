"""Times and positions of the synthetic spacecraft's passes over the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError
from spcola.math import lattice

_DAY = 86400.0

Pattern = Literal["lattice", "poles-belt-samples"]
# Shares of all passes over each pole and the belt; the rest are samples between.
_POLE_SHARE, _BELT_SHARE = 0.15, 0.4
# One pass of a pole is straight above it, the others around: their scans overlap there.
_POLE_LATITUDE, _NEAR_POLE_LATITUDE = np.radians(88.0), np.radians(75.0)
_SAMPLES_FROM, _SAMPLES_TO = np.radians(20.0), np.radians(62.0)


@dataclass(frozen=True)
class PassSettings:
    """Distribution of the observations over days, local times and the body.

    Parameters
    ----------
    count : int
        Number of passes.
    pattern : {"lattice", "poles-belt-samples"}
        Distribution of directions: evenly over the sphere; or both poles several times, a closed
        belt along the equator, and samples of the middle latitudes.
    directions_deg : tuple of (float, float)
        Longitude and latitude of each pass, degrees, instead of a pattern (and of `count`).
    days : int
        Number of days of the passes.
    local_times_h : tuple of float
        Local solar time under the spacecraft, one for each day in turn, hours.
    nearest, farthest : float
        Distances from O between which the passes lie, metres.
    duration : float
        Duration of a pass, seconds.
    period : float
        Period of the body's rotation, seconds.
    sun_latitude_deg : float
        Latitude of the sub-solar point: small, so that a pole remains dark.
    epoch : float
        Ephemeris time at which the first day begins, s (2019 JUL 01 00:00 UTC).
    """

    count: int = 20
    pattern: Pattern = "lattice"
    directions_deg: tuple[tuple[float, float], ...] = ()
    days: int = 5
    local_times_h: tuple[float, ...] = (9.5, 11.0, 12.5, 14.0, 15.5)
    nearest: float = 3000.0
    farthest: float = 4000.0
    duration: float = 300.0
    period: float = 4.296 * 3600.0
    sun_latitude_deg: float = 2.0
    epoch: float = 615_211_269.184

    def __post_init__(self) -> None:
        places = tuple((float(place[0]), float(place[1])) for place in self.directions_deg)
        object.__setattr__(self, "directions_deg", places)
        object.__setattr__(self, "local_times_h", tuple(map(float, self.local_times_h)))
        if (self.count < 4 and not places) or self.days < 1 or not self.local_times_h:
            raise SettingsError("needs four passes, a day and a local time at least", "passes")
        if self.pattern not in get_args(Pattern):
            patterns = ", ".join(get_args(Pattern))
            raise SettingsError(f"is none of {patterns}: {self.pattern!r}", "pattern of the passes")
        if any(abs(latitude) > 90.0 for _, latitude in places):
            raise SettingsError("a latitude lies beyond a pole", "directions of the passes")
        if not abs(self.sun_latitude_deg) <= 90.0:
            raise SettingsError(
                f"must lie within ± 90, not {self.sun_latitude_deg}", "sun_latitude_deg"
            )
        if not (0 < self.nearest <= self.farthest and 0 < self.duration < self.period):
            raise SettingsError("distances, duration or period out of range", "passes")

    def sun(self, time: float) -> FloatArray:
        """Return the unit vector (3,) to the Sun, body-fixed, at ephemeris time `time`, s."""
        return direction_of(self.sun_longitude(time), np.radians(self.sun_latitude_deg))

    def sun_longitude(self, time: float) -> float:
        """Return the longitude of the sub-solar point at `time`, s: radians, 0 at the epoch."""
        return float(-2.0 * np.pi * (time - self.epoch) / self.period)


@dataclass(frozen=True)
class Pass:
    """One pass: the spacecraft is fixed in space while the body rotates under it.

    Attributes
    ----------
    number : int
        From 1, in order of time.
    start, duration, period : float
        Seconds; the start is ephemeris time. The period is the body's rotation.
    longitude, latitude : float
        Of the spacecraft at the middle of the pass, body-fixed, radians.
    distance : float
        Distance from O, metres.
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

    def position(self, time: FloatArray) -> FloatArray:
        """Return true positions (N, 3), metres, body-fixed, at `time` (N,), s."""
        turned = 2.0 * np.pi * (np.asarray(time) - self.middle) / self.period
        return self.distance * direction_of(self.longitude - turned, self.latitude)

    def velocity(self, time: FloatArray) -> FloatArray:
        """Return the rate (N, 3), m/s, of the body-fixed position at `time` (N,), s."""
        position = self.position(time)
        rate = 2.0 * np.pi / self.period
        zero = np.zeros_like(position[..., 0])
        return rate * np.stack([position[..., 1], -position[..., 0], zero], axis=-1)


def plan_passes(settings: PassSettings, generator: np.random.Generator) -> list[Pass]:
    """Return the passes of some `settings` in order of time; `generator` gives their distances.

    The directions are assigned to the days in turn. A day has one local time; the next pass is
    always the one whose longitude has that time soonest after the pass before, so that few
    rotations suffice for many passes.


    Raises
    ------
    SettingsError
        If the passes of a day do not fit into it.
    """
    places = pass_directions(settings)
    distances = generator.uniform(settings.nearest, settings.farthest, size=len(places))
    passes: list[Pass] = []
    for day in range(settings.days):
        free = settings.epoch + day * _DAY
        local_time_h = settings.local_times_h[day % len(settings.local_times_h)]
        waiting = list(range(day, len(places), settings.days))
        while waiting:
            waits = [_wait(settings, places[k, 0], local_time_h, free) for k in waiting]
            soonest = int(np.argmin(waits))
            k, start = waiting.pop(soonest), free + waits[soonest]
            free = start + settings.duration
            longitude, latitude = map(float, places[k])
            passes.append(
                Pass(
                    len(passes) + 1, start, settings.duration, settings.period,
                    longitude, latitude, float(distances[k]),
                )
            )  # fmt: skip
        if free > settings.epoch + (day + 1) * _DAY:
            raise SettingsError(
                f"{len(places)} do not fit into {settings.days} days", "passes", "allow more days"
            )
    return passes


def pass_directions(settings: PassSettings) -> FloatArray:
    """Return longitudes and latitudes (N, 2), radians, under the spacecraft, of all passes."""
    if settings.directions_deg:
        return np.radians(np.array(settings.directions_deg))
    if settings.pattern == "lattice":
        x, y, z = lattice(settings.count).T
        return np.stack([np.arctan2(y, x), np.arcsin(z)], axis=1)
    polar = max(1, round(_POLE_SHARE * settings.count))
    belt = max(1, round(_BELT_SHARE * settings.count))
    rest = settings.count - belt - 2 * polar
    # The rings begin at different longitudes: passes of one longitude wait for a rotation each.
    north, south = _pole(polar, 0.25), _pole(polar, 0.75) * [1.0, -1.0]
    return np.concatenate([north, south, _ring(belt, 0.0, 0.0), _samples(rest)])


def _pole(count: int, first: float) -> FloatArray:
    """Return passes (N, 2) over the north pole and around it."""
    around = _ring(count - 1, _NEAR_POLE_LATITUDE, first)
    return np.concatenate([np.array([[np.pi * first, _POLE_LATITUDE]]), around])


def _ring(count: int, latitude: float, first: float) -> FloatArray:
    """Return places (N, 2) at equal steps of longitude, the `first` of them in steps from 0."""
    longitude = 2.0 * np.pi * (np.arange(count) + first) / max(count, 1)
    return np.stack([longitude, np.full(count, latitude)], axis=1)


def _samples(count: int) -> FloatArray:
    """Return places (N, 2) in the middle latitudes, north and south in turn."""
    share = (np.arange(count) + 0.5) / max(count, 1)
    low, high = np.sin(_SAMPLES_FROM), np.sin(_SAMPLES_TO)
    # Fibonacci's spiral on either hemisphere: no two samples near each other.
    latitude = np.arcsin(low + (high - low) * share) * np.where(np.arange(count) % 2, -1.0, 1.0)
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    return np.stack([longitude % (2.0 * np.pi), latitude], axis=1)


def _wait(settings: PassSettings, longitude: float, local_time_h: float, free: float) -> float:
    """Return the time after `free`, s, until a pass begins whose middle has the local time."""
    noon = longitude - np.radians(15.0 * (local_time_h - 12.0))
    phase = (settings.sun_longitude(free + settings.duration / 2.0) - noon) / (2.0 * np.pi)
    return float((phase % 1.0) * settings.period)


def direction_of(longitude: float | FloatArray, latitude: float) -> FloatArray:
    """Return unit vectors (…, 3) of longitudes (…) at one latitude, radians."""
    ring = np.cos(latitude)
    z = np.full(np.shape(longitude), np.sin(latitude))
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), z], axis=-1)
