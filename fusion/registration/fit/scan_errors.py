"""Effect of the errors of scans on the mapolas that are made of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lidar.adjustment import ScanAdjustment, displacement_partials
from spcola.arrays import FloatArray
from spcola.math.statistics import covariance_root

# A pattern that displaces the mapolas by less than this (root of the sum of squares, metres) is far
# below the error of a match, and counts as an independent error of each mapola.
_LEAST = 1e-3
# Mapolas whose displacements by all scans are in memory at once.
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class ScanErrorPatterns:
    """Error patterns of scans, each of standard deviation 1, and their residual covariance.

    Parameters
    ----------
    names : tuple of str
        The S scans.
    center : (S, 3) ndarray
        Body-fixed point about which each is rotated, metres.
    modes : (6S, M) ndarray
        Displacement (metres) and rotation (radians) of each scan in each pattern.
    residual : (6S, 6S) ndarray, optional
        Residual covariance of the displacements, in addition to the patterns; 0 if not given.
    wander_m : float
        Standard deviation, each axis, metres, of local displacements of a scan.
    """

    names: tuple[str, ...]
    center: FloatArray
    modes: FloatArray
    residual: FloatArray | None = None
    wander_m: float = 0.0

    @classmethod
    def independent(cls, names: Sequence[str], sigma_m: float) -> ScanErrorPatterns:
        """Return independent errors of scans, `sigma_m` metres along each axis; 0 for none.

        Parameters
        ----------
        names : sequence of str
            Of the scans.
        sigma_m : float
        """
        columns = 3 * len(names) if sigma_m > 0 else 0
        modes = np.zeros((len(names), 6, columns))
        if columns:
            modes[:, :3] = sigma_m * np.eye(columns).reshape(-1, 3, columns)
        return cls(tuple(names), np.zeros((len(names), 3)), modes.reshape(6 * len(names), columns))

    @classmethod
    def of_adjustment(
        cls, adjustment: ScanAdjustment, shares: FloatArray, points: FloatArray
    ) -> ScanErrorPatterns:
        """Return the errors that an adjustment leaves, as patterns that displace the mapolas.

        Parameters
        ----------
        adjustment : ScanAdjustment
        shares : (N, S) ndarray
            Shares of the mapolas' returns, by ``adjustment.names``.
        points : (N, 3) ndarray
            The mapolas' centres, body-fixed, metres.
        """
        root = covariance_root(adjustment.covariance)
        products = np.zeros((root.shape[1], root.shape[1]))
        for displaced in _displaced(adjustment.center, shares, points):
            moved = displaced.reshape(-1, len(root)) @ root
            products += moved.T @ moved
        square, directions = np.linalg.eigh(products)
        kept = square > _LEAST**2
        modes, others = root @ directions[:, kept], root @ directions[:, ~kept]
        wander = adjustment.sizes.wander_m
        return cls(adjustment.names, adjustment.center, modes, others @ others.T, wander)

    def at(self, shares: FloatArray, points: FloatArray) -> FloatArray:
        """Displacements (N, 3, M), metres, of mapolas at `points` (N, 3) by each pattern.

        `shares` (N, S) are the shares of scans in the mapolas' returns.
        """
        parts = [rows @ self.modes for rows in _displaced(self.center, shares, points)]
        effects: FloatArray = np.concatenate([np.zeros((0, 3, self.modes.shape[1])), *parts])
        return effects

    def residual_covariance(self, shares: FloatArray, points: FloatArray) -> FloatArray:
        """Covariances (N, 3, 3), m², of the displacements of mapolas not due to the patterns.

        Parameters
        ----------
        shares : (N, S) ndarray
            Share of each scan in each mapola.
        points : (N, 3) ndarray
            Centres of the mapolas, metres.
        """
        variance = self.wander_m**2 * np.sum(shares**2, axis=1)
        covariance: FloatArray = variance[:, None, None] * np.eye(3)
        if self.residual is not None:
            parts = [
                np.einsum("nip,njp->nij", rows @ self.residual, rows)
                for rows in _displaced(self.center, shares, points)
            ]
            covariance = covariance + np.concatenate([np.zeros((0, 3, 3)), *parts])
        return covariance

    def displacements(self, strengths: FloatArray) -> FloatArray:
        """Displacement of each scan's centre, metres, and rotation about it, radians (S, 6).

        `strengths` (M,) are those of the patterns.
        """
        return (self.modes @ strengths).reshape(-1, 6)


def mapola_shifts(
    center: FloatArray, displacement: FloatArray, shares: FloatArray, points: FloatArray
) -> FloatArray:
    """Displacements (N, 3), metres, of mapolas at `points` (N, 3) by those of their scans.

    Parameters
    ----------
    center : (S, 3) ndarray
        Point about which each scan is rotated, metres.
    displacement : (S, 6) ndarray
        Of each scan, metres and radians.
    shares : (N, S) ndarray
        Shares of scans in the mapolas' returns.
    points : (N, 3) ndarray
        The mapolas' centres, metres.
    """
    whole = displacement.ravel()
    parts = [rows @ whole for rows in _displaced(center, shares, points)]
    shifts: FloatArray = np.concatenate([np.zeros((0, 3)), *parts])
    return shifts


def _displaced(center: FloatArray, shares: FloatArray, points: FloatArray) -> Iterator[FloatArray]:
    """Yield partials (n, 3, 6S) of some mapolas' positions by the displacements of scans."""
    for first in range(0, len(points), _CHUNK):
        some = slice(first, first + _CHUNK)
        rows = shares[some, :, None, None] * displacement_partials(points[some, None], center)
        yield rows.transpose(0, 2, 1, 3).reshape(len(rows), 3, -1)


def share_matrix(shares: Sequence[dict[str, float]], names: Sequence[str]) -> FloatArray:
    """Convert the shares of N mapolas by scan name to a matrix (N, S) in the order of `names`."""
    column = {name: index for index, name in enumerate(names)}
    matrix = np.zeros((len(shares), len(names)))
    for row, share in enumerate(shares):
        for name, value in share.items():
            matrix[row, column[name]] = value
    return matrix
