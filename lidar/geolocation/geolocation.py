"""Geolocation of a scan's returns with another trajectory, pole, spin or prime meridian.

A return is the position of the spacecraft plus the beam. Body-fixed coordinates rotate with the
assumed rotation of the body, ``p → R(t) p``, and move with the spacecraft:

    p' = R(t) p + d(t),    d(t) = s'(t) − R(t) s(t)

with s and s' the old and the new trajectory. Both are smooth: d, and R as a rotation vector, are
stored at some times and interpolated linearly. Pointing and range are unchanged.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from lidar.geolocation.interpolation import move_points
from lidar.geolocation.mirror import MirrorMotion
from lidar.geolocation.range_shift import RangeShift
from lidar.scans import Scan
from lidar.scans.cubes import QUANTUM_M
from spcola.arrays import BoolArray, FloatArray, read_only
from spcola.errors import InvalidValueError
from spcola.navigation import Offset, Spin, Trajectory

MAX_GAP_S = 3600.0
"""Default for the longest time between two states over which their offset is interpolated."""

# Error of interpolated rotation vectors, metres at the returns: a tenth of the rounding of places.
_TOLERANCE_M = 0.1 * QUANTUM_M
# Most times of a scan for that; only bodies that rotate in minutes need more.
_MOST_TIMES = 100_000


class Unlocated(StrEnum):
    """Reasons under which returns that cannot be geolocated are counted."""

    NO_TIME = "no time"
    OUTSIDE_TRAJECTORY = "outside trajectory"
    OUTSIDE_KERNELS = "outside kernels"


@dataclass(frozen=True, eq=False)
class Geolocation:
    """Motion of the returns of one scan, by time, relative to their places in its file.

    Attributes
    ----------
    turn_time, turn : (K,), (K, 3) ndarrays
        Seconds, and rotation vectors about the origin, radians; empty without a rotation.
    shift_time, shift : (M,), (M, 3) ndarrays
        Seconds, and displacements, metres, added after the rotation; empty for the trajectory
        of the scan itself, if `moves` is False. At a time whose displacement is NaN, and up to
        the next, returns have no place.
    moves : bool
        Whether there is another trajectory: returns at times that it does not cover have no place.
    max_gap_s : float
        Displacements further apart than this are not interpolated between.
    error_m : float
        Error of interpolation, metres: the largest between kernel times, one standard deviation
        in the longest gap between states of images.
    mirror : MirrorMotion, optional
        Error of the lidar's mirror, corrected before anything else.
    ranges : RangeShift, optional
        Correction of the ranges, before anything else.
    outside : Unlocated
        The reason under which returns at times that are not covered are counted.
    """

    turn_time: FloatArray = field(default_factory=lambda: np.empty(0))
    turn: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    shift_time: FloatArray = field(default_factory=lambda: np.empty(0))
    shift: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    moves: bool = False
    max_gap_s: float = np.inf
    error_m: float = 0.0
    mirror: MirrorMotion | None = None
    ranges: RangeShift | None = None
    outside: Unlocated = Unlocated.OUTSIDE_TRAJECTORY

    @classmethod
    def by_rotation(
        cls, span: tuple[float, float], radius: float, old: Spin, new: Spin
    ) -> Geolocation:
        """Return the rotation from `old` to `new` of returns within `radius` (m) of the origin.

        `span` are the first and the last ephemeris time, s.
        """
        times = _turn_times(span, radius, old, new)
        return cls(times, old.change_to(new, times))

    def apply(self, points: FloatArray, time: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return body-fixed `points` (N, 3), metres, at their new places, and which have one (N,).

        Those without one are NaN: where the ephemeris `time` (N,), s, is unknown or not covered.
        """
        if self.ranges is not None:
            points = self.ranges.apply(points, time)
        if self.mirror is not None:
            points = self.mirror.apply(points, time)
        gap = self.max_gap_s if self.moves else np.nan
        moved, kept = move_points(
            _alike(points),
            _alike(time),
            _alike(self.turn_time),
            _alike(self.turn),
            _alike(self.shift_time),
            _alike(self.shift),
            gap,
        )
        return moved, kept

    def apply_to_scan(self, scan: Scan) -> Scan:
        """Return `scan` with points, stations and beams at their new places.

        Returns without a place are counted as rejected, by reason.
        """
        points, kept = self.apply(scan.points, scan.time)
        # A beam has no direction where the point is at the lidar itself.
        station, _ = replace(self, mirror=None, ranges=None).apply(scan.spacecraft, scan.time)
        ahead, _ = replace(self, ranges=None).apply(scan.spacecraft + scan.beam, scan.time)
        longer = 0.0 if self.ranges is None else self.ranges.shift_m
        timeless = int(np.count_nonzero(np.isnan(scan.time)))
        rejected = Counter(scan.rejected)
        if timeless:
            rejected[Unlocated.NO_TIME] += timeless
        if outside := int(np.count_nonzero(~kept)) - timeless:
            rejected[self.outside] += outside
        chosen = scan.select(kept)
        return replace(
            chosen,
            points=points[kept],
            spacecraft=station[kept],
            beam=(ahead - station)[kept],
            range=chosen.range + longer,
            rejected=rejected,
        )

    def covers(self, time: FloatArray) -> BoolArray:
        """Return at which of the ephemeris times `time` (N,), s, returns have a place (N,)."""
        if not self.moves:
            return np.isfinite(time)
        return self.apply(np.zeros((len(time), 3)), time)[1]

    def reach(self, radius: float) -> float:
        """Return the largest displacement of a point within `radius` of the origin, metres."""
        angle = np.linalg.norm(self.turn, axis=1).max(initial=0.0)
        shift = np.fmax.reduce(np.linalg.norm(self.shift, axis=1), initial=0.0)
        along = 0.0 if self.ranges is None else abs(self.ranges.shift_m)
        mirror = 0.0 if self.mirror is None else self.mirror.reach(radius + along)
        rotated = 2.0 * np.sin(min(angle, np.pi) / 2.0) * (radius + along)
        return float(rotated + shift + mirror + along)


def find_geolocation(
    old: Trajectory,
    radius: float,
    *,
    spin: tuple[Spin, Spin] | None = None,
    trajectory: Trajectory | None = None,
    max_gap_s: float = np.inf,
) -> Geolocation:
    """Return the motion of the returns of a scan.

    Parameters
    ----------
    old : Trajectory
        Trajectory by which the scan was located, over its whole span.
    radius : float
        Largest distance of its returns from the origin, metres.
    spin : (Spin, Spin), optional
        The body's rotation by which the scan was located, and the corrected one.
    trajectory : Trajectory, optional
        The new one, in the body-fixed frame of the corrected rotation.
    max_gap_s : float
        Returns between two times of `trajectory` further apart than this, seconds, get no place.

    Raises
    ------
    InvalidValueError
        If the trajectories have no time in common.
    """
    turns = Geolocation() if spin is None else Geolocation.by_rotation(old.span, radius, *spin)
    if trajectory is None:
        return turns
    times = trajectory.time[old.covers(trajectory.time)]
    reference = old
    if spin is not None and len(times):
        there = spin[0].moved(old.at(times), spin[1], times)
        reference = Trajectory(old.name, times, there)
    return _shifted(turns, trajectory.offset_from(reference), max_gap_s)


def _shifted(turns: Geolocation, offset: Offset, max_gap_s: float) -> Geolocation:
    """Return the geolocation that turns, and then moves as the offset of two trajectories does."""
    return replace(
        turns,
        shift_time=offset.differences.time,
        shift=offset.differences.position,
        moves=True,
        max_gap_s=max_gap_s,
        error_m=offset.widest(max_gap_s),
    )


def geolocated_by(
    scan: Scan, trajectory: Trajectory, *, max_gap_s: float = MAX_GAP_S
) -> tuple[Scan, Offset]:
    """Return a scan located with another trajectory, and the difference to the scan's own.

    The *difference* of the trajectories is interpolated linearly to the time of each return: it is
    smooth where the positions themselves rotate with the body, so that a trajectory known at image
    times only can be used for the returns between them. Pointing is unchanged.

    Parameters
    ----------
    scan : Scan
        With times and the spacecraft positions by which it was located.
    trajectory : Trajectory
        The new one, in the same body-fixed frame.
    max_gap_s : float
        Returns between two times further apart than this, seconds, are rejected and counted, as
        are those outside the trajectory.

    Raises
    ------
    InvalidValueError
        If the two trajectories have no time in common, or the scan has no position at a time.
    """
    offset = trajectory.offset_from(scan_trajectory(scan), max_gap_s=max_gap_s)
    moved = _shifted(Geolocation(), offset, max_gap_s).apply_to_scan(scan)
    return replace(moved, trajectory=trajectory.name), offset


def scan_trajectory(scan: Scan) -> Trajectory:
    """Return the spacecraft positions of a scan as a trajectory, its times sorted and unique.

    Raises
    ------
    InvalidValueError
        If no return has both a time and a spacecraft position.
    """
    known = np.isfinite(scan.time) & np.isfinite(scan.spacecraft).all(axis=1)
    if not known.any():
        raise InvalidValueError(
            "has no time with a spacecraft position", scan.name, "give a reference trajectory"
        )
    time, first = np.unique(scan.time[known], return_index=True)
    return Trajectory(scan.trajectory, time, scan.spacecraft[known][first])


def _turn_times(span: tuple[float, float], radius: float, old: Spin, new: Spin) -> FloatArray:
    """Times between which linear interpolation of the rotation vector is good enough."""
    size = float(np.linalg.norm(old.change_to(new, np.array(span)), axis=1).max())
    # A sine of the spin's period and of that size departs from its chord by size·(rate·step)²/8.
    rate = max([1e-12, *(abs(spin.rate(time)) for spin in (old, new) for time in span)])
    step = np.sqrt(8.0 * _TOLERANCE_M / max(size * radius, 1e-12)) / rate
    begin, end = span[0], max(span[1], span[0] + 1.0)
    count = int(np.clip(np.ceil((end - begin) / step), 1, _MOST_TIMES))
    return np.linspace(begin, end, count + 1)


def _alike(array: FloatArray) -> FloatArray:
    """Return `array` as the kernel gets all of them, so that it is compiled once."""
    return read_only(np.ascontiguousarray(array))
