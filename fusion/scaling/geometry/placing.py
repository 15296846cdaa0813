"""Where the lidar surface lies to the SPC surface, as far as an estimate has told."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray

# The surface lies where it is believed to, once an estimate moves it by less than this share of
# its sigma.
_SETTLED = 0.05


@dataclass(frozen=True, eq=False)
class KnownPlace:
    """How the lidar surface lies to the SPC surface, beside the scale.

    Slopes of a shape hold its noise. An estimate by them falls short of a displacement by the share
    that noise has in them; what is left of it is told again where the surface is believed to lie.

    Parameters
    ----------
    center : (3,) ndarray
        Offset of the centre, metres.
    turn : (3,) ndarray
        Rotation that takes lidar coordinates to SPC coordinates, radians.
    """

    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    turn: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, estimate: FloatArray) -> KnownPlace:
        """Take it from an estimate (8,) of :func:`fusion.scaling.fit.estimate_scale`."""
        return cls(estimate[1:4], estimate[4:7])

    @property
    def parameters(self) -> FloatArray:
        """As parameters (8,) of the estimate: no scale, no range bias."""
        return np.concatenate([[0.0], self.center, self.turn, [0.0]])

    def displaced(self, arm: FloatArray) -> FloatArray:
        """How far (N, 3) the lidar surface lies from SPC at arms (N, 3), metres."""
        away: FloatArray = self.center - np.cross(self.turn, arm)
        return away

    def is_told_by(self, estimate: FloatArray, sigma: FloatArray) -> bool:
        """Whether an estimate (8,) made there leaves it where it is."""
        moved = estimate[1:7] - np.concatenate([self.center, self.turn])
        return bool(np.max(np.abs(moved) / sigma[1:7]) < _SETTLED)
