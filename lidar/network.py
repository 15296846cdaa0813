"""The network of scans and overlaps: displacements, and the sizes of what errs.

Errors are of several kinds, each of a size that the overlaps themselves tell: displacements of
scans along the radius, and across it, where pointing errs too; their rotations; and what no
displacement of a whole scan describes: trajectory and pointing wander during a scan, so that it
lies a little otherwise on each grid on which it is compared. Without the last, thousands of cells
that share such an error would count as thousands of witnesses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lidar.overlaps import DEGREES, OverlapEquations
from spcola.arrays import FloatArray, IntArray

# Sizes count as found when a round changes none of them by more than this share.
_SETTLED = 0.01
_MAX_ROUNDS = 60
# Metres and radians: what is smaller is none.
_LEAST = np.array([1e-6, 1e-6, 1e-9, 1e-6])
# Which of the sizes is that of each of a scan's six numbers.
_KINDS = np.array([0, 1, 1, 2, 2, 2])
# Share of the variance that the arcs of one scan have in common: a trajectory errs over minutes and
# over days.
_ALIKE = 0.5
# What tells of a size less than one independent number would does not tell it.
_TELLING = 1.0


@dataclass(frozen=True)
class ErrorSizes:
    """Standard deviations of what errs.

    Parameters
    ----------
    up_m : float
        Displacement of a scan along the radius to its middle, metres.
    across_m : float
        The same along either direction across it.
    rotation_rad : float
        Its rotation about each axis, radians.
    wander_m : float
        Its own displacement on one grid, each axis, metres.
    """

    up_m: float
    across_m: float
    rotation_rad: float
    wander_m: float

    @property
    def all(self) -> FloatArray:
        """The four of them, in this order."""
        return np.array([self.up_m, self.across_m, self.rotation_rad, self.wander_m])

    def local(self, scans: int) -> FloatArray:
        """Sigmas (6S,) of the displacements of scans, each in its own frame: up comes first."""
        return np.tile(self.all[_KINDS], scans)


@dataclass(frozen=True, eq=False)
class NetworkSolution:
    """What a network of S scans says.

    Attributes
    ----------
    displacement : (6S,) ndarray
        Metres and radians, body-fixed.
    covariance : (6S, 6S) ndarray
    sizes : ErrorSizes
    """

    displacement: FloatArray
    covariance: FloatArray
    sizes: ErrorSizes


@dataclass(frozen=True, eq=False)
class Nodes:
    """What can be displaced: S scans, or arcs of scans.

    Parameters
    ----------
    center : (S, 3) ndarray
        Point about which each is turned, body-fixed, metres.
    scan : (S,) ndarray of int
        The scan of each: arcs of one scan err alike in part, and count for one scan when sizes are
        estimated.
    """

    center: FloatArray
    scan: IntArray

    def __len__(self) -> int:
        return len(self.center)

    @classmethod
    def whole(cls, center: FloatArray) -> Nodes:
        """Return scans none of which is cut into arcs."""
        return cls(center, np.arange(len(center)))

    @cached_property
    def share(self) -> FloatArray:
        """One over the number of arcs (S,) that the scan of each is cut into."""
        _, own, count = np.unique(self.scan, return_inverse=True, return_counts=True)
        share: FloatArray = 1.0 / count[own]
        return share

    @cached_property
    def frames(self) -> FloatArray:
        """Orthonormal rows (S, 3, 3), the first along the radius."""
        frames = np.tile(np.eye(3), (len(self), 1, 1))
        for frame, center in zip(frames, self.center, strict=True):
            if center.any():
                # The other two directions are any: nothing tells them apart.
                frame[:] = np.linalg.qr(np.column_stack([center, np.eye(3)]))[0].T
        return frames

    def prior(self, sizes: ErrorSizes) -> FloatArray:
        """Covariance (6S, 6S), body-fixed, of displacements of the stated sizes."""
        local = sizes.local(len(self))
        alike = self._alike(lambda _: (1.0 - _ALIKE, _ALIKE))
        return _turned(alike * np.outer(local, local), self.frames.transpose(0, 2, 1))

    @cached_property
    def precision(self) -> FloatArray:
        """Inverse (6S, 6S) of the correlations of displacements, in the frames."""
        return self._alike(
            lambda count: (
                1.0 / (1.0 - _ALIKE),
                -_ALIKE / ((1.0 - _ALIKE) * (1.0 - _ALIKE + _ALIKE * count)),
            )
        )

    def _alike(self, shares: Callable[[int], tuple[float, float]]) -> FloatArray:
        """Matrix (6S, 6S), in the frames, of what arcs have for themselves and together.

        `shares` says how much of the two, for the number of a scan's arcs. What they have together
        is the same vector in the body-fixed frame.
        """
        matrix = np.eye(DEGREES * len(self))
        for scan in np.unique(self.scan[self.share < 1.0]):
            arcs = np.flatnonzero(self.scan == scan)
            own, together = shares(len(arcs))
            at = columns(arcs)
            shared = np.tile(np.eye(DEGREES), (len(arcs), len(arcs)))
            matrix[np.ix_(at, at)] = own * np.eye(len(at)) + together * _turned(
                shared, self.frames[arcs]
            )
        return matrix


def columns(scan: IntArray) -> IntArray:
    """Where the unknowns of the scans (K,) are among those of all."""
    found: IntArray = (DEGREES * scan[:, None] + np.arange(DEGREES)).ravel()
    return found


def _turned(matrix: FloatArray, frames: FloatArray) -> FloatArray:
    """Turn the metres of K scans in a matrix (6K, 6K) by `frames` (K, 3, 3)."""
    count = len(frames)
    turned = matrix.reshape(count, DEGREES, count, DEGREES).copy()
    turned[:, :3] = np.einsum("kij,kjlm->kilm", frames, turned[:, :3])
    turned[..., :3] = np.einsum("lij,kmlj->kmli", frames, turned[..., :3])
    return turned.reshape(matrix.shape)


def _turned_vector(vector: FloatArray, frames: FloatArray) -> FloatArray:
    """Turn the metres of K scans in a vector (6K,)."""
    turned = vector.reshape(-1, DEGREES).copy()
    turned[:, :3] = np.einsum("kij,kj->ki", frames, turned[:, :3])
    return turned.ravel()


def solve_network(
    parts: Sequence[OverlapEquations],
    nodes: Nodes,
    sizes: ErrorSizes,
    *,
    excess: float = 1.0,
    estimate: bool = True,
) -> NetworkSolution:
    """Solve the displacements of all scans, and the sizes of the errors.

    The sizes maximise the marginal likelihood: the fixed point of MacKay (1992, eq. 2.23), squares
    over the number of well determined unknowns. Against EM it does not dwell where it began because
    of scans of which nothing is known.

    Parameters
    ----------
    parts : sequence of OverlapEquations
        For whole displacements.
    nodes : Nodes
    sizes : ErrorSizes
        First values; or the ones that hold, with ``estimate=False``.
    excess : float
        The variances of the parts are too small by this factor.
    """
    heard = [
        _LocalEquations.of(part, nodes.frames[part.scan], excess) for part in parts if part.weight
    ]
    for _ in range(_MAX_ROUNDS if estimate else 1):
        solution = _at(heard, nodes, sizes)
        if not estimate:
            break
        found = _renewed(solution, heard, nodes.share)
        change = float(np.abs(np.log(found.all / sizes.all)).max())
        sizes = found
        if change < _SETTLED:
            break
    back = nodes.frames.transpose(0, 2, 1)
    return NetworkSolution(
        _turned_vector(solution.displacement, back),
        _turned(solution.covariance, back),
        solution.sizes,
    )


@dataclass(frozen=True, eq=False)
class _LocalEquations:
    """Equations of one grid in the scans' frames; `moved` are the columns of metres."""

    at: IntArray
    moved: IntArray
    normal: FloatArray
    right: FloatArray

    @classmethod
    def of(cls, part: OverlapEquations, frames: FloatArray, excess: float) -> _LocalEquations:
        moved = (DEGREES * np.arange(len(part.scan))[:, None] + np.arange(3)).ravel()
        normal, right = _turned(part.normal, frames), _turned_vector(part.right, frames)
        return cls(columns(part.scan), moved, normal / excess, right / excess)

    def own(self, wander_m: float) -> FloatArray:
        """Covariance of the scans' own displacements on the grid, all others known."""
        inner = self.normal[np.ix_(self.moved, self.moved)] * wander_m**2
        covariance: FloatArray = np.linalg.inv(inner + np.eye(len(inner))) * wander_m**2
        return covariance

    def without_own(self, wander_m: float) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and right side with these displacements eliminated."""
        shared = self.normal[:, self.moved]
        taken = shared @ self.own(wander_m)
        return self.normal - taken @ shared.T, self.right - taken @ self.right[self.moved]


def _at(parts: Sequence[_LocalEquations], nodes: Nodes, sizes: ErrorSizes) -> NetworkSolution:
    """Solve at given sizes."""
    root = sizes.local(len(nodes))
    normal: FloatArray = np.zeros((len(root), len(root)))
    right: FloatArray = np.zeros(len(root))
    for part in parts:
        reduced, reduced_right = part.without_own(sizes.wander_m)
        normal[np.ix_(part.at, part.at)] += reduced
        right[part.at] += reduced_right
    # Scaled by the prior, as metres and radians are unlike.
    scaled = normal * np.outer(root, root) + nodes.precision
    covariance = np.linalg.inv(scaled) * np.outer(root, root)
    return NetworkSolution(covariance @ right, covariance, sizes)


def _renewed(
    solution: NetworkSolution, parts: Sequence[_LocalEquations], share: FloatArray
) -> ErrorSizes:
    """Return the sizes that the squares of what was found speak for."""
    sizes, count = solution.sizes, len(solution.displacement) // DEGREES
    kind = np.tile(_KINDS, count)
    known = 1.0 - np.diag(solution.covariance) / sizes.local(count) ** 2
    each = np.repeat(share, DEGREES)
    squares = np.bincount(kind, weights=each * solution.displacement**2, minlength=4)
    told = np.bincount(kind, weights=each * known, minlength=4)
    for local in parts:
        own = local.own(sizes.wander_m)
        rest = local.right - local.normal @ solution.displacement[local.at]
        carried = own @ local.normal[local.moved]
        spread = own + carried @ solution.covariance[np.ix_(local.at, local.at)] @ carried.T
        squares[3] += np.sum((own @ rest[local.moved]) ** 2)
        told[3] += np.sum(1.0 - np.diag(spread) / sizes.wander_m**2)
    new = np.where(told > _TELLING, np.sqrt(squares / np.maximum(told, _TELLING)), sizes.all)
    return replace(sizes, **dict(zip(vars(sizes), np.maximum(new, _LEAST).tolist(), strict=True)))
