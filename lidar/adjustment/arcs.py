"""Arcs of scans, which are displaced as a whole, and the sizes of their errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lidar.adjustment.overlaps import COMPONENTS
from spcola.arrays import FloatArray, IntArray

# Index of the size of each of a scan's six numbers.
SIZE_OF_NUMBER = np.array([0, 1, 1, 2, 2, 2])
# Share of the variance common to the arcs of one scan: a trajectory has errors over minutes and
# over days.
_COMMON = 0.5


@dataclass(frozen=True)
class ScanErrorSizes:
    """Standard deviations of the errors.

    Parameters
    ----------
    up_m : float
        Displacement of a scan along the radius to its middle, metres.
    across_m : float
        The same along either direction across it.
    rotation_rad : float
        Its rotation about each axis, radians.
    wander_m : float
        Its additional displacement on one grid, each axis, metres.
    day_m : float
        Additional displacement along the radius of all scans of a day, metres.
    """

    up_m: float
    across_m: float
    rotation_rad: float
    wander_m: float
    day_m: float

    @property
    def all(self) -> FloatArray:
        """The five of them, in this order."""
        return np.array([self.up_m, self.across_m, self.rotation_rad, self.wander_m, self.day_m])

    def local(self, scans: int) -> FloatArray:
        """Sigmas (6S,) of the displacements of scans, each in its own frame: up comes first."""
        return np.tile(self.all[SIZE_OF_NUMBER], scans)


@dataclass(frozen=True, eq=False)
class RigidArcs:
    """S arcs of scans, each displaced and rotated as a whole; a short scan is one arc.

    Parameters
    ----------
    center : (S, 3) ndarray
        Point about which each is rotated, body-fixed, metres.
    scan : (S,) ndarray of int
        The scan of each: arcs of one scan have correlated errors, and count for one scan when
        sizes are estimated.
    day : (S,) ndarray of int
        The day of each; negative where unknown.
    """

    center: FloatArray
    scan: IntArray
    day: IntArray

    def __len__(self) -> int:
        return len(self.center)

    @classmethod
    def whole(cls, center: FloatArray) -> RigidArcs:
        """Return whole scans of unknown days, their middles at `center` (S, 3), metres."""
        return cls(center, np.arange(len(center)), np.full(len(center), -1))

    @cached_property
    def share(self) -> FloatArray:
        """One over the number of arcs (S,) of the scan of each."""
        _, own, count = np.unique(self.scan, return_inverse=True, return_counts=True)
        share: FloatArray = 1.0 / count[own]
        return share

    @cached_property
    def frames(self) -> FloatArray:
        """Orthonormal rows (S, 3, 3), the first along the radius."""
        frames = np.tile(np.eye(3), (len(self), 1, 1))
        for frame, center in zip(frames, self.center, strict=True):
            if center.any():
                # The other two directions are arbitrary: they have the same size.
                rows = np.linalg.qr(np.column_stack([center, np.eye(3)]))[0].T
                frame[:] = np.sign(rows[0] @ center) * rows
        return frames

    def prior(self, sizes: ScanErrorSizes) -> FloatArray:
        """Covariance (6S, 6S), body-fixed, of displacements of the stated sizes."""
        local = sizes.local(len(self))
        covariance = self._correlations(lambda _: (1.0 - _COMMON, _COMMON)) * np.outer(local, local)
        covariance += sizes.day_m**2 * self.day_partials @ self.day_partials.T
        return rotated(covariance, self.frames.transpose(0, 2, 1))

    @cached_property
    def day_partials(self) -> FloatArray:
        """Displacements (6S, G) due to each of the G days, in the frames."""
        days = np.unique(self.day[self.day >= 0])
        day_partials = np.zeros((len(self), COMPONENTS, len(days)))
        day_partials[:, 0] = self.day[:, None] == days
        return day_partials.reshape(COMPONENTS * len(self), len(days))

    @cached_property
    def precision(self) -> FloatArray:
        """Inverse (6S, 6S) of the correlations of displacements, in the frames."""
        return self._correlations(
            lambda count: (
                1.0 / (1.0 - _COMMON),
                -_COMMON / ((1.0 - _COMMON) * (1.0 - _COMMON + _COMMON * count)),
            )
        )

    def _correlations(self, shares: Callable[[int], tuple[float, float]]) -> FloatArray:
        """Matrix (6S, 6S), in the frames, of the independent and the common part of arcs.

        `shares` returns the weights of the two for the number of a scan's arcs. The common part is
        the same vector in the body-fixed frame.
        """
        matrix = np.eye(COMPONENTS * len(self))
        for scan in np.unique(self.scan[self.share < 1.0]):
            arcs = np.flatnonzero(self.scan == scan)
            own, together = shares(len(arcs))
            at = columns(arcs)
            shared = np.tile(np.eye(COMPONENTS), (len(arcs), len(arcs)))
            matrix[np.ix_(at, at)] = own * np.eye(len(at)) + together * rotated(
                shared, self.frames[arcs]
            )
        return matrix


def columns(scan: IntArray) -> IntArray:
    """Positions of the unknowns of the scans (K,) among those of all."""
    found: IntArray = (COMPONENTS * scan[:, None] + np.arange(COMPONENTS)).ravel()
    return found


def rotated(matrix: FloatArray, frames: FloatArray) -> FloatArray:
    """Rotate the translations of K scans in a matrix (6K, 6K) by `frames` (K, 3, 3)."""
    count = len(frames)
    found = matrix.reshape(count, COMPONENTS, count, COMPONENTS).copy()
    found[:, :3] = np.einsum("kij,kjlm->kilm", frames, found[:, :3])
    found[..., :3] = np.einsum("lij,kmlj->kmli", frames, found[..., :3])
    return found.reshape(matrix.shape)


def rotated_vector(vector: FloatArray, frames: FloatArray) -> FloatArray:
    """Rotate the translations of K scans in a vector (6K,) by `frames` (K, 3, 3)."""
    found = vector.reshape(-1, COMPONENTS).copy()
    found[:, :3] = np.einsum("kij,kj->ki", frames, found[:, :3])
    return found.ravel()
