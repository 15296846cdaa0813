"""The network of scans and overlaps: displacements, and the sizes of what errs.

Errors are of several kinds, each of a size that the overlaps themselves tell: displacements of
scans along the radius, and across it, where pointing errs too; their rotations; and what no
displacement of a whole scan describes: trajectory and pointing wander during a scan, so that it
lies a little otherwise on each grid on which it is compared. Without the last, thousands of cells
that share such an error would count as thousands of witnesses. Ranges of one day err alike (at
Bennu by up to 2.5e-4), which lifts all scans of that day: forty scans of five days do not tell the
radius of the body as forty independent ones would.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from lidar.overlaps import DEGREES, OverlapEquations
from spcola.arrays import FloatArray, IntArray

# Sizes count as found when a round changes none of them by more than this share.
_SETTLED = 0.01
_MAX_ROUNDS = 60
# Metres and radians: what is smaller is none.
_LEAST = np.array([1e-6, 1e-6, 1e-9, 1e-6, 1e-6])
# Which of the sizes is that of each of a scan's six numbers, of what it has on one grid, of a day.
_KINDS, _WANDER, _DAY = np.array([0, 1, 1, 2, 2, 2]), 3, 4
# Share of the variance that the arcs of one scan have in common: a trajectory errs over minutes and
# over days.
_ALIKE = 0.5
# Numbers that the first guess of a size counts for: a handful of days does not tell theirs.
_GUESSED = 4.0


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
    day_m : float
        Displacement along the radius that all scans of a day have beside, metres.
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
    day : (S,) ndarray of int
        The day of each; negative where it is not known.
    """

    center: FloatArray
    scan: IntArray
    day: IntArray

    def __len__(self) -> int:
        return len(self.center)

    @classmethod
    def whole(cls, center: FloatArray) -> Nodes:
        """Return scans none of which is cut into arcs, of unknown days."""
        return cls(center, np.arange(len(center)), np.full(len(center), -1))

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
                rows = np.linalg.qr(np.column_stack([center, np.eye(3)]))[0].T
                frame[:] = np.sign(rows[0] @ center) * rows
        return frames

    def prior(self, sizes: ErrorSizes) -> FloatArray:
        """Covariance (6S, 6S), body-fixed, of displacements of the stated sizes."""
        local = sizes.local(len(self))
        alike = self._alike(lambda _: (1.0 - _ALIKE, _ALIKE)) * np.outer(local, local)
        alike += sizes.day_m**2 * self.lifted @ self.lifted.T
        return _turned(alike, self.frames.transpose(0, 2, 1))

    @cached_property
    def lifted(self) -> FloatArray:
        """What each of the G days displaces (6S, G), in the frames."""
        days = np.unique(self.day[self.day >= 0])
        lifted = np.zeros((len(self), DEGREES, len(days)))
        lifted[:, 0] = self.day[:, None] == days
        return lifted.reshape(DEGREES * len(self), len(days))

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
        First guesses, which count for a few numbers each; or what holds, with ``estimate=False``.
    excess : float
        The variances of the parts are too small by this factor.
    """
    first = sizes
    heard = [
        _LocalEquations.of(part, nodes.frames[part.scan], excess) for part in parts if part.weight
    ]
    for _ in range(_MAX_ROUNDS if estimate else 1):
        solution, parted = _at(heard, nodes, sizes)
        if not estimate:
            break
        found = _renewed(solution, parted, heard, nodes.share, first)
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


@dataclass(frozen=True, eq=False)
class _Parted:
    """Displacements of scans (6S) and days (G), apart, in the scans' frames, with variances."""

    value: FloatArray
    variance: FloatArray


def _at(
    parts: Sequence[_LocalEquations], nodes: Nodes, sizes: ErrorSizes
) -> tuple[NetworkSolution, _Parted]:
    """Solve at given sizes, in the scans' frames."""
    count, days = nodes.lifted.shape
    normal: FloatArray = np.zeros((count, count))
    right: FloatArray = np.zeros(count)
    for part in parts:
        reduced, reduced_right = part.without_own(sizes.wander_m)
        normal[np.ix_(part.at, part.at)] += reduced
        right[part.at] += reduced_right
    # A scan is displaced by itself, and with its day; scaled by the prior, as metres and radians
    # are unlike.
    both = np.hstack([np.eye(count), nodes.lifted])
    both *= np.concatenate([sizes.local(len(nodes)), np.full(days, sizes.day_m)])
    scaled = both.T @ normal @ both + block_diag(nodes.precision, np.eye(days))
    inverse = np.linalg.inv(scaled)
    value = inverse @ (both.T @ right)
    solution = NetworkSolution(both @ value, both @ inverse @ both.T, sizes)
    return solution, _Parted(value, np.diag(inverse))


def _renewed(
    solution: NetworkSolution,
    parted: _Parted,
    parts: Sequence[_LocalEquations],
    share: FloatArray,
    first: ErrorSizes,
) -> ErrorSizes:
    """Return the sizes that the squares of what was found speak for, and the `first` ones a bit."""
    sizes, days = solution.sizes, len(parted.value) - len(solution.displacement)
    kind = np.concatenate([np.tile(_KINDS, len(share)), np.full(days, _DAY)])
    each = np.concatenate([np.repeat(share, DEGREES), np.ones(days)])
    squares = np.bincount(kind, weights=each * parted.value**2, minlength=5) * sizes.all**2
    told = np.bincount(kind, weights=each * (1.0 - parted.variance), minlength=5)
    for local in parts:
        own = local.own(sizes.wander_m)
        rest = local.right - local.normal @ solution.displacement[local.at]
        carried = own @ local.normal[local.moved]
        spread = own + carried @ solution.covariance[np.ix_(local.at, local.at)] @ carried.T
        squares[_WANDER] += np.sum((own @ rest[local.moved]) ** 2)
        told[_WANDER] += np.sum(1.0 - np.diag(spread) / sizes.wander_m**2)
    new = np.sqrt((squares + _GUESSED * first.all**2) / (told + _GUESSED))
    return replace(sizes, **dict(zip(vars(sizes), np.maximum(new, _LEAST).tolist(), strict=True)))
