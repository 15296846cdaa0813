"""Estimated placement of the lidar surface relative to the SPC surface."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from spcola.arrays import FloatArray

# Convergence: an estimate changes the placement by less than this share of its sigma.
_CONVERGED = 0.05


@dataclass(frozen=True, eq=False)
class LidarPlacement:
    """Offset and rotation of the lidar surface relative to the SPC surface, without scale.

    It is the point at which observations are linearised. Slopes of a shape include noise, and an
    estimate underestimates a displacement by the share of noise in the squared slopes; iterating at
    the estimated placement removes this bias.

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
    def of(cls, estimate: FloatArray) -> LidarPlacement:
        """Return that of an estimate (8,) of :func:`fusion.scaling.fit.estimate_scale`."""
        return cls(estimate[1:4], estimate[4:7])

    @property
    def parameters(self) -> FloatArray:
        """Parameters (8,) of the estimate, with scale and range bias 0."""
        return np.concatenate([[0.0], self.center, self.turn, [0.0]])

    def displaced(self, arm: FloatArray) -> FloatArray:
        """Displacement (N, 3), metres, of the lidar surface from SPC at points `arm` (N, 3)."""
        away: FloatArray = self.center - np.cross(self.turn, arm)
        return away

    def agrees_with(self, estimate: FloatArray, sigma: FloatArray) -> bool:
        """Return whether a new estimate (8,) differs by a negligible share of `sigma` (8,)."""
        moved = estimate[1:7] - np.concatenate([self.center, self.turn])
        return bool(np.max(np.abs(moved) / sigma[1:7]) < _CONVERGED)
