"""Returns located by SPICE kernels: another trajectory, pointing, rotation, or mounting."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.spatial.transform import Rotation

from lidar.geolocation.geolocation import Geolocation, Unlocated
from lidar.geolocation.knots import knots
from lidar.geolocation.mirror import MirrorAngles, MirrorMotion
from spcola.arrays import FloatArray
from spcola.navigation import Trajectory
from spcola.spice import (
    POINTING_TOLERANCE_S,
    KernelCoverage,
    KernelSet,
    body_fixed_states,
    coverage,
)

# Error of linear interpolation between the times at which kernels are read, metres at the returns.
_TOLERANCE_M = 5e-4


@dataclass(frozen=True, eq=False)
class KernelPlace:
    """Position and orientation of a lidar from kernels.

    Parameters
    ----------
    kernels : KernelSet
        By which returns are located.
    spacecraft : str
        Name or NAIF number.
    body : int
        NAIF number of the body, whose rotation the kernels give.
    frame : str
        Frame of the lidar. Without one beams keep their body-fixed direction.
    reference : KernelSet, optional
        Kernels by which returns were located: the frame's old orientation. By default `kernels`.
    boresight : (3,) ndarray
        Rotation vector, radians, by which beams are rotated in the frame.
    pupil : (3,) ndarray
        Shift of the lidar's pupil in the frame, metres.
    mirror : MirrorAngles
        Errors of its mirror angles, in the frame.
    max_gap_s : float
        States and attitudes of kernels further apart than this, seconds, are not interpolated
        between: returns there have no place.
    tolerance_s : float
        Largest distance in time from a pointing of a CK at which it is used, seconds.
    """

    kernels: KernelSet
    spacecraft: str
    body: int
    frame: str = ""
    reference: KernelSet | None = None
    boresight: FloatArray = field(default_factory=lambda: np.zeros(3))
    pupil: FloatArray = field(default_factory=lambda: np.zeros(3))
    mirror: MirrorAngles = field(default_factory=MirrorAngles)
    max_gap_s: float = np.inf
    tolerance_s: float = POINTING_TOLERANCE_S

    @cached_property
    def coverage(self) -> KernelCoverage:
        """Times at which all kernel data for the location of returns exist.

        Raises
        ------
        KernelError
            If a kernel is refused, or a name in it unknown.
        """
        with self.kernels.load():
            known = self._coverage(self.spacecraft)
        if self.reference is not None:
            with self.reference.load():
                known &= self._coverage("")
        return known

    def _coverage(self, spacecraft: str) -> KernelCoverage:
        return coverage(
            spacecraft, frame=self.frame, max_gap_s=self.max_gap_s, tolerance_s=self.tolerance_s
        )

    def geolocation(
        self, old: Trajectory, radius: float, times: FloatArray | None = None
    ) -> Geolocation:
        """Return the motion of the returns of a scan.

        A return p was located as the position s(t) of the spacecraft plus a beam. In the frame of
        the lidar this is rotated by its mounting B (after the mirror's correction), and the
        frame's axes (rows) A(t) become A'(t):

            p' = s' + A'ᵀ o + Q (p − s),    Q = A'ᵀ B A

        Parameters
        ----------
        old : Trajectory
            Trajectory by which the scan was located, over its whole span.
        radius : float
            Largest distance of its returns from the origin, metres.
        times : (M,) ndarray, optional
            Times of the returns, ephemeris s, sorted and unique. By default returns may be at any
            time of the span.

        Returns
        -------
        Geolocation
            Returns at times that the kernels do not cover have no place. Kernels are read at the
            time of each return, or densely enough that the error of linear interpolation, given
            by `error_m`, is below 0.5 mm.

        Raises
        ------
        KernelError
            If a kernel is refused, or a name in it unknown.
        """
        begin, end = old.span
        if times is not None and len(times):
            begin, end = min(begin, times[0]), max(end, times[-1])
        time, value, error = knots(
            partial(self._motion, old),
            partial(self._departure, old, radius),
            (begin, max(end, begin + 1.0)),
            _TOLERANCE_M,
            times,
            np.unique(self.coverage.windows()),
        )
        known = np.isfinite(value).all(axis=1)
        turn, before = value[:, :3], value[known, 6:].reshape(-1, 3, 3)
        mirror = None
        if self.mirror and known.any():
            station = old.at(np.clip(time[known], *old.span))
            mirror = MirrorMotion(self.mirror, time[known], station, before)
        turns = known & bool(turn[known].any())
        return Geolocation(
            time[turns], turn[turns], time, value[:, 3:6], moves=True, error_m=error,
            mirror=mirror, outside=Unlocated.OUTSIDE_KERNELS,
        )  # fmt: skip

    def _departure(self, old: Trajectory, radius: float, off: FloatArray) -> FloatArray:
        """Displacement of returns (N,), m, due to errors of rotation, shift and axes (N, 15)."""
        departure = radius * np.linalg.norm(off[:, :3], axis=1)
        departure += np.linalg.norm(off[:, 3:6], axis=1)
        if self.mirror:
            away = float(np.linalg.norm(old.position, axis=1).max())
            reach = self.mirror.most * (away + radius)
            departure += reach * np.linalg.norm(off[:, 6:], axis=1)
        return np.asarray(departure)

    def _motion(self, old: Trajectory, time: FloatArray) -> FloatArray:
        """Rotation vectors of Q, ``s' + A'ᵀ o − Q s``, m, and A, side by side: (N, 15).

        NaN where unknown.
        """
        value = np.full((len(time), 15), np.nan)
        known = self.coverage.covers(time)
        covered = time[known]
        if not len(covered):
            return value
        inside = old.at(np.clip(covered, *old.span))
        place, axes = self._states(self.kernels, self.spacecraft, covered)
        if not self.frame:
            value[known] = np.hstack([np.zeros_like(place), place - inside, axes.reshape(-1, 9)])
            return value
        before = axes
        if self.reference is not None and self.reference.paths != self.kernels.paths:
            _, before = self._states(self.reference, "", covered)
        mounting = Rotation.from_rotvec(self.boresight).as_matrix()
        q = np.swapaxes(axes, 1, 2) @ mounting @ before
        there = np.isfinite(q).all(axis=(1, 2))
        turn = np.full((len(covered), 3), np.nan)
        turn[there] = Rotation.from_matrix(q[there]).as_rotvec()
        pupil = np.einsum("nij,i->nj", axes, self.pupil)
        shift = place + pupil - np.einsum("nij,nj->ni", q, inside)
        value[known] = np.hstack([turn, shift, before.reshape(-1, 9)])
        return value

    def _states(
        self, kernels: KernelSet, spacecraft: str, time: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        with kernels.load():
            return body_fixed_states(
                spacecraft, self.body, time, frame=self.frame, tolerance_s=self.tolerance_s
            )
