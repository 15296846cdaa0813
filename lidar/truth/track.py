"""Nadir tracks: a spacecraft on a circular orbit that looks straight down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import SettingsError


@dataclass(frozen=True)
class TrackSettings:
    """Tracks of shots toward O from circular orbits.

    Parameters
    ----------
    count : int
        Number of tracks; their ascending nodes are spread evenly over the orbits' plane.
    distance : float
        Distance of the orbits from O, metres.
    inclination_deg : float
        Against the body's equator; 90 passes over the poles.
    orbit_period, period : float
        Of the orbit, and of the body's rotation, seconds. 22 h is that of 1 km from Bennu.
    duration : float
        Duration of a track, seconds.
    rate : float
        Shots per second.
    epoch : float
        Ephemeris time at which the first track begins, s; each begins where the last one ends.
    """

    count: int = 4
    distance: float = 1000.0
    inclination_deg: float = 85.0
    orbit_period: float = 22.0 * 3600.0
    period: float = 4.296 * 3600.0
    duration: float = 6.0 * 3600.0
    rate: float = 1.0
    epoch: float = 615_211_269.184

    def __post_init__(self) -> None:
        sizes = (self.distance, self.orbit_period, self.period, self.duration, self.rate)
        if self.count < 1 or not all(0 < size < np.inf for size in sizes):
            raise SettingsError("needs a track, and positive sizes and times", "tracks")
        if self.duration * self.rate < 1:
            raise SettingsError("is over before its first shot", "tracks")

    def plan(self) -> list[NadirTrack]:
        """Return the tracks in order of time, one after the other on one orbit.

        The first begins over the south (at the argument −90°), with the node at body-fixed
        longitude 0; the body's rotation spreads later ones over all longitudes.
        """
        tracks = []
        for index in range(self.count):
            elapsed = index * self.duration
            tracks.append(
                NadirTrack(
                    index + 1, self.epoch + elapsed, self.duration, self.rate, self.distance,
                    float(np.radians(self.inclination_deg)),
                    float(-2.0 * np.pi * elapsed / self.period),
                    float(-np.pi / 2.0 + 2.0 * np.pi * elapsed / self.orbit_period),
                    self.orbit_period, self.period,
                )
            )  # fmt: skip
        return tracks


@dataclass(frozen=True)
class NadirTrack:
    """One track: the spacecraft moves on its orbit while the body rotates under it.

    Attributes
    ----------
    number : int
        From 1, in order of time.
    start, duration : float
        Seconds; the start is ephemeris time.
    rate : float
        Shots per second.
    distance : float
        Distance from O, metres.
    inclination, node, argument : float
        Orbit at the start, radians: against the equator; longitude of the ascending node,
        body-fixed; angle from there along the orbit.
    orbit_period, period : float
        Of the orbit and of the body's rotation, seconds.
    """

    number: int
    start: float
    duration: float
    rate: float
    distance: float
    inclination: float
    node: float
    argument: float
    orbit_period: float
    period: float

    @property
    def middle(self) -> float:
        """Ephemeris time of the middle, s."""
        return self.start + self.duration / 2.0

    @property
    def shots(self) -> int:
        """Number of shots."""
        return int(self.duration * self.rate)

    def position(self, time: FloatArray) -> FloatArray:
        """Return true positions (N, 3), metres, body-fixed, at each `time` (N,), s."""
        elapsed = np.asarray(time) - self.start
        angle = self.argument + 2.0 * np.pi * elapsed / self.orbit_period
        node = self.node - 2.0 * np.pi * elapsed / self.period
        ahead, aside = np.cos(angle), np.sin(angle) * np.cos(self.inclination)
        x = ahead * np.cos(node) - aside * np.sin(node)
        y = ahead * np.sin(node) + aside * np.cos(node)
        z = np.sin(angle) * np.sin(self.inclination)
        return self.distance * np.stack([x, y, z], axis=-1)
