"""What the errors of scans do to the mapolas that are made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidar.adjustment import ScanAdjustment
from lidar.overlaps import displacement_rows
from spcola.arrays import FloatArray

# Patterns of displacements below this, metres, are lost in the noise of any match.
_LEAST = 5e-4


@dataclass(frozen=True, eq=False)
class ScanEffects:
    """Patterns of scan displacements that may still be there, each of standard deviation 1.

    Parameters
    ----------
    names : tuple of str
        The S scans.
    center : (S, 3) ndarray
        Body-fixed point about which each is turned, metres.
    modes : (6S, M) ndarray
        Displacement (metres) and rotation (radians) of each scan in each pattern.
    """

    names: tuple[str, ...]
    center: FloatArray
    modes: FloatArray

    @classmethod
    def independent(cls, names: Sequence[str], sigma_m: float) -> ScanEffects:
        """Scans that err independently, by `sigma_m` metres along each axis; 0: not at all."""
        columns = 3 * len(names) if sigma_m > 0 else 0
        modes = np.zeros((len(names), 6, columns))
        if columns:
            modes[:, :3] = sigma_m * np.eye(columns).reshape(-1, 3, columns)
        return cls(tuple(names), np.zeros((len(names), 3)), modes.reshape(6 * len(names), columns))

    @classmethod
    def left_by(
        cls, adjustment: ScanAdjustment, shares: FloatArray, points: FloatArray
    ) -> ScanEffects:
        """What an adjustment left unknown, as far as it is felt at mapolas.

        Parameters
        ----------
        adjustment : ScanAdjustment
        shares : (N, S) ndarray
            Of the mapolas' returns, by ``adjustment.names``.
        points : (N, 3) ndarray
            The mapolas' centres, body-fixed, metres.
        """
        square = np.sum((points[:, None] - adjustment.center) ** 2, axis=2)
        reach = float(np.sqrt(np.sum(shares * square) / max(float(shares.sum()), 1e-12)))
        modes = adjustment.modes(reach=reach, least=_LEAST)
        return cls(adjustment.names, adjustment.center, modes)

    def at(self, shares: FloatArray, points: FloatArray) -> FloatArray:
        """Displacements (N, 3, M), metres, of mapolas at `points` (N, 3) by each pattern.

        `shares` (N, S) are those of the mapolas' returns.
        """
        rows = displacement_rows(points[:, None], self.center)
        mean = np.einsum("ns,nsij->nisj", shares, rows).reshape(len(points), 3, len(self.modes))
        effects: FloatArray = mean @ self.modes
        return effects

    def offsets(self, strengths: FloatArray) -> FloatArray:
        """Displacement (S, 3) of each scan's centre, metres, by patterns of `strengths` (M,)."""
        return (self.modes @ strengths).reshape(-1, 6)[:, :3]


def share_matrix(shares: Sequence[dict[str, float]], names: Sequence[str]) -> FloatArray:
    """Turn the shares of N mapolas by scan name into a matrix (N, S), in the order of `names`."""
    column = {name: index for index, name in enumerate(names)}
    matrix = np.zeros((len(shares), len(names)))
    for row, share in enumerate(shares):
        for name, value in share.items():
            matrix[row, column[name]] = value
    return matrix
