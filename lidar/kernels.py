"""Returns located by SPICE kernels: another trajectory, pointing, rotation, or mounting."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from lidar.mirror import MirrorAngles, MirrorMotion
from lidar.relocation import Relocation
from spcola.arrays import BoolArray, FloatArray
from spcola.spice import KernelSet, body_fixed_states
from spcola.trajectory import Trajectory

# Straight lines between the times at which kernels are asked are this good where returns lie.
_TOLERANCE_M = 5e-4
# Where the kernels end within a scan is found this well, seconds: what is beyond has no place.
_EDGE_S = 1.0
# Times of a scan: begun with the fewest, doubled until that is so.
_FEWEST, _MOST = 33, 8193


@dataclass(frozen=True, eq=False)
class KernelPlace:
    """Where kernels say that a lidar was, and where it looked.

    Parameters
    ----------
    kernels : KernelSet
        By which returns are located.
    spacecraft : str
        Name or NAIF number.
    body : int
        NAIF number of the body, whose rotation the kernels tell.
    frame : str
        Of the lidar. Without one beams keep their body-fixed direction.
    reference : KernelSet, optional
        By which returns were located: where the frame pointed then. By default `kernels`.
    boresight : (3,) ndarray
        Rotation vector, radians, by which beams are turned in the frame.
    pupil : (3,) ndarray
        Shift of the lidar's pupil in the frame, metres.
    mirror : MirrorAngles
        What its mirror's angles err by, in the frame.
    """

    kernels: KernelSet
    spacecraft: str
    body: int
    frame: str = ""
    reference: KernelSet | None = None
    boresight: FloatArray = field(default_factory=lambda: np.zeros(3))
    pupil: FloatArray = field(default_factory=lambda: np.zeros(3))
    mirror: MirrorAngles = field(default_factory=MirrorAngles)

    def relocation(self, old: Trajectory, radius: float) -> Relocation:
        """Find how the returns of a scan move.

        A return p was where the spacecraft s(t) and the way v of the beam put it. The way is v in
        the frame of the lidar, turned by its mounting B (and by the mirror before that), and the
        frame's axes (rows) A(t) have become A'(t):

            p' = s' + A'ᵀ o + Q (p − s),    Q = A'ᵀ B A

        Parameters
        ----------
        old : Trajectory
            By which the scan was located, over its whole span.
        radius : float
            Largest distance of its returns from the origin, metres.

        Returns
        -------
        Relocation
            Without a place are returns at times that the kernels do not cover.

        Raises
        ------
        KernelError
            If a kernel is refused, or a name in it unknown.
        """
        begin, end = old.span
        end = max(end, begin + 1.0)
        count, mirror = _FEWEST, None
        while True:
            time = np.linspace(begin, end, count)
            turn, shift, before = self._motion(old, time)
            known = np.isfinite(shift).all(axis=1)
            error = _departure(shift) + radius * _departure(turn)
            if self.mirror:
                mirror = MirrorMotion(
                    self.mirror, time[known], old.at(np.clip(time[known], *old.span)), before[known]
                )
                error += mirror.reach(radius) * _departure(before.reshape(-1, 9))
            step = (end - begin) / (count - 1)
            fine = error <= _TOLERANCE_M and (known.all() or not known.any() or step <= _EDGE_S)
            if fine or count >= _MOST:
                break
            count = 2 * count - 1
        turns = known & bool(turn[known].any())
        return Relocation(
            time[turns],
            turn[turns],
            time[known],
            shift[known],
            moves=True,
            max_gap_s=1.5 * step,
            error_m=error,
            mirror=mirror if len(time[known]) else None,
        )

    def _motion(
        self, old: Trajectory, time: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rotation vectors of Q (N, 3), ``s' + A'ᵀ o − Q s`` (N, 3), m, and A (N, 3, 3).

        NaN where unknown.
        """
        inside = np.clip(time, *old.span)
        with self.kernels.load():
            place, axes = body_fixed_states(self.spacecraft, self.body, time, frame=self.frame)
        turn = np.zeros((len(time), 3))
        if not self.frame:
            return turn, place - old.at(inside), axes
        before = axes
        if self.reference is not None:
            with self.reference.load():
                _, before = body_fixed_states(self.spacecraft, self.body, time, frame=self.frame)
        mounting = Rotation.from_rotvec(self.boresight).as_matrix()
        q = np.swapaxes(axes, 1, 2) @ mounting @ before
        known: BoolArray = np.all(np.isfinite(q), axis=(1, 2))
        turn[known] = Rotation.from_matrix(q[known]).as_rotvec()
        pupil = np.einsum("nij,i->nj", axes, self.pupil)
        shift = place + pupil - np.einsum("nij,nj->ni", q, old.at(inside))
        return turn, np.where(known[:, None], shift, np.nan), before


def _departure(values: FloatArray) -> float:
    """Distance of values (N, ...) at even steps from straight lines, estimated from every second.

    The departure falls fourfold when steps are halved. Where values are unknown it says nothing.
    """
    off = np.linalg.norm(values[1:-1:2] - (values[:-2:2] + values[2::2]) / 2.0, axis=1) / 4.0
    return float(np.nanmax(off, initial=0.0)) if np.isfinite(off).any() else 0.0
