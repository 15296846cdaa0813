"""The network of scans and overlaps: displacements, and the sizes of the errors.

Each type of error has a size that is estimated from the overlaps: displacements of scans along the
radius, and across it, where pointing contributes too; their rotations; and errors that vary within
a scan: trajectory and pointing wander, so that a scan has a slightly different displacement on each
grid on which it is compared. Without the last, thousands of cells with a common error would count
as independent. Ranges of one day have a common error (at Bennu up to 2.5e-4), which lifts all scans
of that day: forty scans of five days do not determine the radius of the body as forty independent
ones would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from lidar.adjustment.arcs import (
    SIZE_OF_NUMBER,
    RigidArcs,
    ScanErrorSizes,
    columns,
    rotated,
    rotated_vector,
)
from lidar.adjustment.overlaps import COMPONENTS, OverlapEquations
from spcola.arrays import FloatArray, IntArray
from spcola.errors import NotObservableError

# Sizes have converged when a round changes none of them by more than this share.
_CONVERGED = 0.01
_MAX_ROUNDS = 60
# Smallest size, metres and radians.
_LEAST = np.array([1e-6, 1e-6, 1e-9, 1e-6, 1e-6])
# Index of the size of a scan's displacement on one grid, and of that of a day.
_WANDER, _DAY = 3, 4
# Weight of the first guess of a size, in numbers: a handful of days does not determine theirs.
_GUESSED = 4.0


@dataclass(frozen=True, eq=False)
class NetworkSolution:
    """Solution of a network of S scans.

    Attributes
    ----------
    displacement : (6S,) ndarray
        Metres and radians, body-fixed.
    covariance : (6S, 6S) ndarray
    sizes : ScanErrorSizes
    """

    displacement: FloatArray
    covariance: FloatArray
    sizes: ScanErrorSizes


def solve_network(
    parts: Sequence[OverlapEquations],
    arcs: RigidArcs,
    sizes: ScanErrorSizes,
    *,
    start: ScanErrorSizes | None = None,
    excess: float = 1.0,
    estimate: bool = True,
) -> NetworkSolution:
    """Solve the displacements of all scans, and the sizes of the errors.

    The sizes maximise the marginal likelihood: the fixed point of MacKay (1992, eq. 2.23), squares
    over the number of well determined unknowns. Unlike EM it does not remain at its start because
    of scans without overlaps.

    Parameters
    ----------
    parts : sequence of OverlapEquations
        Normal equations of whole displacements.
    arcs : RigidArcs
    sizes : ScanErrorSizes
        First guesses, which count for a few numbers each; or the fixed sizes, with
        ``estimate=False``.
    start : ScanErrorSizes, optional
        Where the search begins, by default at the first guesses.
    excess : float
        Factor by which the variances of the parts are too small.
    """
    first, sizes = sizes, start or sizes
    local_parts = [
        _LocalEquations.of(part, arcs.frames[part.scan], excess) for part in parts if part.weight
    ]
    for _ in range(_MAX_ROUNDS if estimate else 1):
        solution, parted = _at(local_parts, arcs, sizes)
        if not estimate:
            break
        found = _renewed(solution, parted, local_parts, arcs.share, first)
        change = float(np.abs(np.log(found.all / sizes.all)).max())
        sizes = found
        if change < _CONVERGED:
            break
    back = arcs.frames.transpose(0, 2, 1)
    return NetworkSolution(
        rotated_vector(solution.displacement, back),
        rotated(solution.covariance, back),
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
        moved = (COMPONENTS * np.arange(len(part.scan))[:, None] + np.arange(3)).ravel()
        normal, right = rotated(part.normal, frames), rotated_vector(part.right, frames)
        return cls(columns(part.scan), moved, normal / excess, right / excess)

    def own(self, wander_m: float) -> FloatArray:
        """Covariance of the scans' additional displacements on the grid, given all others."""
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
    """Displacements of scans (6S) and days (G) in the scans' frames, with variances."""

    value: FloatArray
    variance: FloatArray


def _at(
    parts: Sequence[_LocalEquations], arcs: RigidArcs, sizes: ScanErrorSizes
) -> tuple[NetworkSolution, _Parted]:
    """Solve at given sizes, in the scans' frames."""
    count, days = arcs.day_partials.shape
    normal: FloatArray = np.zeros((count, count))
    right: FloatArray = np.zeros(count)
    for part in parts:
        reduced, reduced_right = part.without_own(sizes.wander_m)
        normal[np.ix_(part.at, part.at)] += reduced
        right[part.at] += reduced_right
    # A scan has its own displacement and that of its day; both are scaled by the prior, since
    # metres and radians have different scales.
    root, day_partials = sizes.local(len(arcs)), sizes.day_m * arcs.day_partials
    by_day = normal @ day_partials
    scaled = np.empty((count + days, count + days))
    scaled[:count, :count] = normal * np.outer(root, root) + arcs.precision
    scaled[:count, count:] = root[:, None] * by_day
    scaled[count:, :count] = scaled[:count, count:].T
    scaled[count:, count:] = day_partials.T @ by_day + np.eye(days)
    inverse = _inverse(scaled)
    value = inverse @ np.concatenate([root * right, day_partials.T @ right])
    # Covariance of the sum of both.
    crossed = root[:, None] * inverse[:count, count:] @ day_partials.T
    covariance = inverse[:count, :count] * np.outer(root, root) + crossed + crossed.T
    covariance += day_partials @ inverse[count:, count:] @ day_partials.T
    displacement = root * value[:count] + day_partials @ value[count:]
    solution = NetworkSolution(displacement, covariance, sizes)
    return solution, _Parted(value, np.diag(inverse).copy())


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a symmetric positive definite matrix, at half the cost of a general one.

    Raises
    ------
    NotObservableError
        If it is not positive definite in double precision.
    """
    lower, failed = dpotrf(matrix, lower=True)
    inverse, failed_too = dpotri(lower, lower=True)
    if failed or failed_too:
        raise NotObservableError(
            "the displacements of the scans are not determined by their overlaps, as large as they "
            "may be by the first guess of their errors",
            do="lower [mapolas] adjust_sigma_m and adjust_sigma_deg, or set adjust = false",
        )
    found: FloatArray = np.tril(inverse)
    return found + np.tril(found, -1).T


def _renewed(
    solution: NetworkSolution,
    parted: _Parted,
    parts: Sequence[_LocalEquations],
    share: FloatArray,
    first: ScanErrorSizes,
) -> ScanErrorSizes:
    """Return the sizes from the squares of the solution, with some weight of the `first` ones."""
    sizes, days = solution.sizes, len(parted.value) - len(solution.displacement)
    kind = np.concatenate([np.tile(SIZE_OF_NUMBER, len(share)), np.full(days, _DAY)])
    each = np.concatenate([np.repeat(share, COMPONENTS), np.ones(days)])
    squares = np.bincount(kind, weights=each * parted.value**2, minlength=5) * sizes.all**2
    determined = np.bincount(kind, weights=each * (1.0 - parted.variance), minlength=5)
    for local in parts:
        own = local.own(sizes.wander_m)
        rest = local.right - local.normal @ solution.displacement[local.at]
        carried = own @ local.normal[local.moved]
        spread = own + carried @ solution.covariance[np.ix_(local.at, local.at)] @ carried.T
        squares[_WANDER] += np.sum((own @ rest[local.moved]) ** 2)
        determined[_WANDER] += np.sum(1.0 - np.diag(spread) / sizes.wander_m**2)
    new = np.sqrt((squares + _GUESSED * first.all**2) / (determined + _GUESSED))
    return replace(sizes, **dict(zip(vars(sizes), np.maximum(new, _LEAST).tolist(), strict=True)))
