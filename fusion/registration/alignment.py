"""The sub-cell displacement of two surfaces by Gauss–Newton, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.kernel import kernel
from spcola.robust import HUBER, MAD_TO_SIGMA, TUKEY, biweight_scores
from spcola.surfacecorrelation import RobustCovariance, robust_covariance

# Fewer points give no displacement.
_LEAST_POINTS = 30
# Steps that weigh by Huber before Tukey may, and that take the spread anew: spread and weights
# that follow each other may go in circles.
_ROUNDS_OF_HUBER, _ROUNDS_OF_SPREAD = 2, 5
# Each so many-th residual tells the spread, to some hundredths.
_THINNED = 4
# Steps, cells, that are small enough after so many.
_TO_AND_FRO = 5e-3
# Slopes that correlate by less have no relief in common: chance makes a few hundredths of ten
# thousand of them.
_TOLD = 0.2


@dataclass(frozen=True, eq=False)
class Fields:
    """Two surfaces on one grid, gaps filled, their common plane taken out.

    Parameters
    ----------
    moving, fixed : (R, C) ndarray
        Metres; finite everywhere.
    moving_known, fixed_known : (R, C) bool ndarray
    sigma : (R, C) ndarray
        Of their difference, relative.
    level : float
        What a filter made of a difference of 1 m that is alike everywhere.
    """

    moving: FloatArray
    moving_known: BoolArray
    fixed: FloatArray
    fixed_known: BoolArray
    sigma: FloatArray
    level: float


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of the difference of two surfaces at a displacement.

    Attributes
    ----------
    standardised : (R, C) ndarray
        Less a plane, over the relative sigma; NaN where nothing was compared.
    moved : (R, C) ndarray
        The moving surface, displaced, metres.
    """

    standardised: FloatArray
    moved: FloatArray

    @property
    def compared(self) -> BoolArray:
        """Mask (R, C) of the points that were compared."""
        return np.isfinite(self.standardised)


@dataclass(frozen=True, eq=False)
class Alignment:
    """The displacement that makes the difference of two surfaces smallest.

    Attributes
    ----------
    shift : (2,) ndarray
        x, y, cells: ``fixed(x) = moving(x − shift) + plane``.
    plane : (3,) ndarray
        Height at the middle, and rise over the grid along x and y, metres.
    covariance : (5, 5) ndarray
        Of shift (cells) and plane (metres).
    patches : float
        Of the differences, about independent.
    left : Left
    iterations : int
    settled : bool
    """

    shift: FloatArray
    plane: FloatArray
    covariance: FloatArray
    patches: float
    left: Left
    iterations: int
    settled: bool


@lru_cache(4)
def tilts(shape: tuple[int, int]) -> FloatArray:
    """Planes (2, R, C) that rise by 1 over a grid along x and along y, 0 in its middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    rising = np.stack(
        [
            (columns - (shape[1] - 1) / 2) / shape[1],
            (rows - (shape[0] - 1) / 2) / shape[0],
        ]
    )
    rising.flags.writeable = False
    return rising


@dataclass(frozen=True)
class Search:
    """How a displacement is looked for.

    Parameters
    ----------
    reach : float
        Cells: the sigma of a displacement that the relief does not tell.
    max_iterations : int
    tolerance : float
        One that moves by less, cells, has settled.
    area : float
        Cells over which errors hold together; 0: as the residual shows. For a start of another
        search a guess will do.
    """

    reach: float
    max_iterations: int
    tolerance: float = 1e-4
    area: float = 0.0


@dataclass(frozen=True, eq=False)
class Aligner:
    """Two surfaces, made ready to be displaced against each other.

    Attributes
    ----------
    fields : Fields
    coefficients : (R, C) ndarray
        Of the cubic spline through the moving surface.
    partials : (R, C, 2) ndarray
        What a displacement does to the difference, by the slopes of the *fixed* surface, over
        sigma. As ``Σ ∂m (f − m)`` changes by ``Σ ∂m ∂f`` when m is displaced, and as the noise of
        one surface has nothing to do with the slopes of the other, this is what the data know;
        squares of one surface's slopes hold its noise.
    """

    fields: Fields
    coefficients: FloatArray
    partials: FloatArray

    @classmethod
    def of(cls, fields: Fields) -> Aligner:
        """Fit the spline, take the slopes."""
        slopes = np.stack(_slopes(fields.fixed), axis=-1)
        partials = -slopes / fields.sigma[..., None]
        return cls(fields, ndimage.spline_filter(fields.moving, order=3), partials)

    def align(self, start: FloatArray, search: Search) -> Alignment | None:
        """Find the displacement near `start` (2,), cells, robustly (Huber, then Tukey).

        Along a direction in which the two surfaces have no relief in common, on a plane or along a
        ridge, nothing is looked for: the displacement is 0 there, ± the reach.

        Returns
        -------
        Alignment or None
            None where too few points are common.
        """
        told = self._told(start)
        if told is None:
            return None
        found = self._settled(told @ (told.T @ start), told, search)
        if found is None:
            return None
        rows, difference, compared, moved = self._linearised(found.shift, told)
        level = _on_grid(difference - rows[:, told.shape[1] :] @ found.plane, compared)
        left = Left(level, moved)
        known = self._covariance(rows, left, found.spread, told, search.area)
        return Alignment(
            shift=found.shift,
            plane=found.plane,
            covariance=_in_full(known.matrix, told, search.reach),
            patches=known.patches,
            left=left,
            iterations=found.iterations,
            settled=found.settled,
        )

    def left_at(self, shift: FloatArray) -> Left:
        """What is left of the difference at a displacement (2,), cells."""
        nowhere = np.zeros((2, 0))
        rows, difference, compared, moved = self._linearised(shift, nowhere)
        found = self._settled(shift, nowhere, Search(0.0, 2))
        plane = np.zeros(3) if found is None else found.plane
        return Left(_on_grid(difference - rows @ plane, compared), moved)

    def _settled(self, start: FloatArray, told: FloatArray, search: Search) -> _Settled | None:
        """Gauss–Newton along `told` (2, K) from a displacement (2,), and the plane there."""
        fields = self.fields
        shift, plane, spread, iterations, settled = _gauss_newton(
            (self.coefficients, fields.fixed, fields.sigma),
            (fields.moving_known, fields.fixed_known),
            np.ascontiguousarray(told),
            fields.level,
            np.array(start, dtype=np.float64),
            (search.max_iterations, search.tolerance),
        )
        return _Settled(shift, plane, spread, iterations, settled) if iterations else None

    def _covariance(
        self, rows: FloatArray, left: Left, spread: float, told: FloatArray, area: float
    ) -> RobustCovariance:
        """Of displacements along `told` and of the plane."""
        compared = left.compared
        rise = rows.copy()
        rise[:, :-3] = self.partials[compared] @ told
        if area > 0.0:
            inverse = np.linalg.inv(rows.T @ rise)
            guess = inverse @ (rows.T @ rows) @ inverse.T * area * spread**2
            return RobustCovariance(guess, len(rows) / area)
        design = np.zeros((*compared.shape, rows.shape[1]))
        design[compared] = rows
        return robust_covariance(design, biweight_scores(left.standardised, spread), rise=rise)

    def _told(self, start: FloatArray) -> FloatArray | None:
        """Directions (2, K), K = 0 … 2, in which both surfaces have relief in common.

        The correlation of their slopes tells: slopes that are noise are each surface's own. None
        where too few points are common.
        """
        fields = self.fields
        moved, held = _displaced(self.coefficients, fields.moving_known, start[0], start[1])
        count, moments = _slope_moments(
            moved, self.partials, fields.sigma, fields.fixed_known & held
        )
        if count < _LEAST_POINTS:
            return None
        common = moments[:2, 2:]
        _, directions = np.linalg.eigh(common + common.T)
        shared, one, two = (
            np.sum(directions * (matrix @ directions), axis=0)
            for matrix in (common, moments[:2, :2], moments[2:, 2:])
        )
        own = one * two
        told: FloatArray = directions[:, shared > _TOLD * np.sqrt(own)]
        return told

    def _linearised(
        self, shift: FloatArray, told: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """Partials (N, K + 3) by displacements along `told` (2, K) and by the plane, over sigma.

        With them the differences (N,) over sigma, where these points are, and the moved surface.
        """
        fields = self.fields
        moved, held = _displaced(self.coefficients, fields.moving_known, shift[0], shift[1])
        compared = fields.fixed_known & held
        rows, difference = _rows(
            moved, fields.fixed, fields.sigma, compared, np.ascontiguousarray(told), fields.level
        )
        return rows, difference, compared, moved


def _in_full(covariance: FloatArray, told: FloatArray, reach: float) -> FloatArray:
    """Covariance (5, 5) of shift and plane from that of the directions `told` (2, K) and plane."""
    count = told.shape[1]
    rise = np.zeros((5, count + 3))
    rise[:2, :count], rise[2:, count:] = told, np.eye(3)
    full: FloatArray = rise @ covariance @ rise.T
    full[:2, :2] += reach**2 * (np.eye(2) - told @ told.T)
    return full


def _on_grid(values: FloatArray, where: BoolArray) -> FloatArray:
    """Values (N,) at the points (R, C) of a mask, NaN elsewhere."""
    layer = np.full(where.shape, np.nan)
    layer[where] = values
    return layer


class _Settled(NamedTuple):
    """Where Gauss–Newton ended, and the robust standard deviation of what is left there."""

    shift: FloatArray
    plane: FloatArray
    spread: float
    iterations: int
    settled: bool


@kernel
def _gauss_newton(
    layers: tuple[FloatArray, FloatArray, FloatArray],
    known: tuple[BoolArray, BoolArray],
    told: FloatArray,
    level: float,
    start: FloatArray,
    limits: tuple[int, float],
) -> tuple[FloatArray, FloatArray, float, int, bool]:
    """Displace, linearise, re-weight, solve, until the displacement settles.

    `layers` are the spline's coefficients, the fixed surface and sigma. After 0 iterations too few
    points are common.
    """
    coefficients, fixed, sigma = layers
    shift, along = start.copy(), told.shape[1]
    estimate, spread = np.zeros(along + 3), 0.0
    for iteration in range(1, limits[0] + 1):
        moved, held = _displaced(coefficients, known[0], shift[0], shift[1])
        rows, difference = _rows(moved, fixed, sigma, known[1] & held, told, level)
        if rows.shape[0] < _LEAST_POINTS:
            return shift, estimate[along:], spread, 0, False
        estimate[:along] = 0.0
        if iteration == 1:
            estimate[along] = np.median(difference / rows[:, along])
        for weighing in range(2 if iteration <= _ROUNDS_OF_HUBER else 1):
            left = difference - rows @ estimate
            # About 0, where the plane of the step before has put their middle.
            if iteration == 1 or (weighing == 0 and iteration <= _ROUNDS_OF_SPREAD):
                spread = MAD_TO_SIGMA * np.median(np.abs(left[:: _THINNED if along else 1]))
            normal, right = _normal(rows, difference, left, spread, iteration > _ROUNDS_OF_HUBER)
            estimate = np.linalg.solve(normal, right)
        most = 0.0
        for axis in range(2):
            offset = 0.0
            for k in range(along):
                offset += told[axis, k] * min(max(estimate[k], -1.0), 1.0)
            shift[axis] += offset
            most = max(most, abs(offset))
        # Where a displacement of 0 changes which points have all their neighbours, it goes to and
        # fro by some thousandths of a cell.
        enough = limits[1] if iteration <= _ROUNDS_OF_SPREAD else max(limits[1], _TO_AND_FRO)
        # A rough answer need not have come to Tukey's weights.
        fewest = 2 if limits[1] > _TO_AND_FRO else _ROUNDS_OF_HUBER + 2
        if most < enough and iteration >= fewest:
            return shift, estimate[along:], spread, iteration, True
    return shift, estimate[along:], spread, limits[0], False


@kernel
def _normal(
    rows: FloatArray, difference: FloatArray, left: FloatArray, spread: float, redescend: bool
) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (P, P) and right side (P,) by Tukey's or Huber's weights.

    Of no spread all weigh 1. Boulders that SPC shortens all lie to one side, and any weight left to
    them would pull the height; but Tukey's need the good start that Huber's lead to.
    """
    count = rows.shape[1]
    normal, right = np.zeros((count, count)), np.zeros(count)
    for n in range(rows.shape[0]):
        weight = 1.0
        if spread > 1e-12:
            ratio = abs(left[n]) / spread
            if redescend:
                weight = (1.0 - min(ratio / TUKEY, 1.0) ** 2) ** 2
            elif ratio > HUBER:
                weight = HUBER / ratio
        for p in range(count):
            scaled = weight * rows[n, p]
            right[p] += scaled * difference[n]
            for q in range(p + 1):
                normal[p, q] += scaled * rows[n, q]
    for p in range(count):
        for q in range(p):
            normal[q, p] = normal[p, q]
    return normal, right


@kernel
def _rows(
    moved: FloatArray,
    fixed: FloatArray,
    sigma: FloatArray,
    compared: BoolArray,
    told: FloatArray,
    level: float,
) -> tuple[FloatArray, FloatArray]:
    """Partials (N, K + 3) and differences (N,) over sigma of the compared points.

    Slopes are antisymmetric differences of the displaced heights and not the spline's own: its
    smoothing of noise depends on where between the points it is evaluated, and slopes that see
    that would draw the displacement to half a cell. By these a noise of the heights is not
    correlated with its slope.
    """
    height, width = moved.shape
    along = told.shape[1]
    rows = np.empty((np.count_nonzero(compared), along + 3))
    difference = np.empty(rows.shape[0])
    n = 0
    for r in range(height):
        for c in range(width):
            if not compared[r, c]:
                continue
            share = 1.0 / sigma[r, c]
            for k in range(along):
                rows[n, k] = -share * (
                    told[0, k] * _slope(moved[r], c) + told[1, k] * _slope(moved[:, c], r)
                )
            rows[n, along] = share * level
            rows[n, along + 1] = share * level * (c - (width - 1) / 2) / width
            rows[n, along + 2] = share * level * (r - (height - 1) / 2) / height
            difference[n] = share * (fixed[r, c] - moved[r, c])
            n += 1
    return rows, difference


@kernel
def _slope_moments(
    moved: FloatArray, partials: FloatArray, sigma: FloatArray, compared: BoolArray
) -> tuple[int, FloatArray]:
    """Points compared, and covariances (4, 4) times their number of slopes over sigma.

    Of the displaced surface along x and y, with its sign turned, then of `partials` (R, C, 2).
    """
    total, moments = np.zeros(4), np.zeros((4, 4))
    value = np.empty(4)
    count = 0
    for r in range(moved.shape[0]):
        for c in range(moved.shape[1]):
            if not compared[r, c]:
                continue
            count += 1
            value[0] = -_slope(moved[r], c) / sigma[r, c]
            value[1] = -_slope(moved[:, c], r) / sigma[r, c]
            value[2], value[3] = partials[r, c, 0], partials[r, c, 1]
            for i in range(4):
                total[i] += value[i]
                for j in range(4):
                    moments[i, j] += value[i] * value[j]
    for i in range(4):
        for j in range(4):
            moments[i, j] -= total[i] * total[j] / max(count, 1)
    return count, moments


@kernel
def _displaced(
    coefficients: FloatArray, known: BoolArray, shift_x: float, shift_y: float
) -> tuple[FloatArray, BoolArray]:
    """Cubic spline at ``(x − shift_x, y − shift_y)``, and where it is known.

    A displacement that is alike everywhere needs one set of weights.
    """
    rows, columns = coefficients.shape
    i, j = int(np.floor(-shift_y)), int(np.floor(-shift_x))
    weight_y, weight_x = _spline(-shift_y - i), _spline(-shift_x - j)
    # Neighbours that a linear interpolation would use.
    down = 1 if -shift_y - i > 1e-9 else 0
    right = 1 if -shift_x - j > 1e-9 else 0
    along = np.zeros(coefficients.shape)
    value = np.zeros(coefficients.shape)
    held = np.zeros(coefficients.shape, dtype=np.bool_)
    for r in range(rows):
        for c in range(columns):
            for n in range(4):
                along[r, c] += weight_x[n] * coefficients[r, _mirrored(c + j + n - 1, columns)]
    for r in range(rows):
        for m in range(4):
            row = _mirrored(r + i + m - 1, rows)
            for c in range(columns):
                value[r, c] += weight_y[m] * along[row, c]
        for c in range(columns):
            if r + i >= 0 and c + j >= 0 and r + i + down < rows and c + j + right < columns:
                held[r, c] = (
                    known[r + i, c + j]
                    and known[r + i + down, c + j]
                    and known[r + i, c + j + right]
                    and known[r + i + down, c + j + right]
                )
    return value, held


@kernel
def _slopes(value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes of heights along x and along y, per cell."""
    slope_x, slope_y = np.empty(value.shape), np.empty(value.shape)
    for r in range(value.shape[0]):
        for c in range(value.shape[1]):
            slope_x[r, c] = _slope(value[r], c)
            slope_y[r, c] = _slope(value[:, c], r)
    return slope_x, slope_y


@kernel
def _slope(line: FloatArray, at: int) -> float:
    """Slope of a line of heights, per cell, from two neighbours on either side."""
    last = line.shape[0] - 1
    near = line[min(at + 1, last)] - line[max(at - 1, 0)]
    far = line[min(at + 2, last)] - line[max(at - 2, 0)]
    if 2 <= at <= last - 2:
        return (8.0 * near - far) / 12.0
    return near / (min(at + 1, last) - max(at - 1, 0))


@kernel
def _spline(t: float) -> FloatArray:
    """Weights (4,) of a cubic B-spline between its second and third coefficient."""
    u = 1.0 - t
    return np.array([u**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * u**2 + 3 * u**3, t**3]) / 6.0


@kernel
def _mirrored(index: int, size: int) -> int:
    """Index of a field that is mirrored at its edge points."""
    if index < 0:
        index = -index
    if index >= size:
        index = 2 * size - 2 - index
    return min(max(index, 0), size - 1)
