"""The sub-cell displacement of two surfaces by Gauss–Newton, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.kernel import kernel
from spcola.robust import HUBER, MAD_TO_SIGMA, huber_weight
from spcola.surfacecorrelation import robust_covariance

# Fewer points give no displacement.
_LEAST_POINTS = 30
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
    left : Left
    iterations : int
    settled : bool
    """

    shift: FloatArray
    plane: FloatArray
    covariance: FloatArray
    left: Left
    iterations: int
    settled: bool


def tilts(shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Planes (R, C) that rise by 1 over a grid along x and along y, 0 in its middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return (columns - (shape[1] - 1) / 2) / shape[1], (rows - (shape[0] - 1) / 2) / shape[0]


def align(
    fields: Fields,
    start: FloatArray,
    *,
    reach: float,
    max_iterations: int,
    tolerance: float = 1e-4,
) -> Alignment | None:
    """Find the displacement near `start` (2,), cells, robustly (Huber).

    Along a direction in which the two surfaces have no relief in common, on a plane or along a
    ridge, nothing is looked for: the displacement is 0 there, ± `reach` (cells). One that moves
    by less than `tolerance`, cells, has settled.

    Returns
    -------
    Alignment or None
        None where too few points are common.
    """
    search = _Search.of(fields)
    told = search.told(start)
    if told is None:
        return None
    shift = told @ (told.T @ start)
    step = _Step(np.zeros(3), 0.0)
    settled, iterations = False, 0
    while not settled and iterations < max_iterations:
        iterations += 1
        rows, difference, _, _ = search.linearised(shift, told)
        if len(rows) < _LEAST_POINTS:
            return None
        step = _robust_step(rows, difference, step)
        offset = told @ np.clip(step.moved, -1.0, 1.0)
        shift = shift + offset
        settled = bool(np.max(np.abs(offset)) < tolerance) and iterations > 2
    rows, difference, compared, moved = search.linearised(shift, told)
    layer = _on_grid(difference - rows[:, told.shape[1] :] @ step.plane, compared)
    design, rise = np.zeros((2, *moved.shape, rows.shape[1]))
    design[compared], rise[compared] = rows, rows
    rise[compared, :-3] = search.fixed_slopes(compared) @ told
    covariance = robust_covariance(design, layer, bound=HUBER * step.spread, rise=rise)
    found = Left(layer, moved)
    return Alignment(
        shift, step.plane, _in_full(covariance, told, reach), found, iterations, settled
    )


def left_at(fields: Fields, near: Alignment, other: Alignment | None) -> Left:
    """What is left of `fields` where they were aligned, or at the shift of `other` if given."""
    if other is None:
        return near.left
    search = _Search.of(fields)
    rows, difference, compared, moved = search.linearised(other.shift, np.zeros((2, 0)))
    step = _robust_step(rows, difference, _Step(np.zeros(3), 0.0))
    return Left(_on_grid(difference - rows @ step.plane, compared), moved)


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


@dataclass(frozen=True, eq=False)
class _Search:
    """What stays the same while the displacement is looked for."""

    fields: Fields
    coefficients: FloatArray
    plane: FloatArray  # (R, C, 3)

    @classmethod
    def of(cls, fields: Fields) -> _Search:
        tilt = tilts(fields.moving.shape)
        plane = fields.level * np.stack([np.ones(fields.moving.shape), *tilt], axis=-1)
        return cls(fields, ndimage.spline_filter(fields.moving, order=3), plane)

    def told(self, start: FloatArray) -> FloatArray | None:
        """Directions (2, K), K = 0 … 2, in which both surfaces have relief in common.

        The correlation of their slopes tells: slopes that are noise are each surface's own. None
        where too few points are common.
        """
        rows, _, compared, _ = self.linearised(start, np.eye(2))
        if len(rows) < _LEAST_POINTS:
            return None
        other = self.fixed_slopes(compared)
        # A filtered plane has slopes too, which all surfaces share.
        one = rows[:, :2] - rows[:, :2].mean(axis=0)
        two = other - other.mean(axis=0)
        common = one.T @ two
        _, directions = np.linalg.eigh(common + common.T)
        one, two = one @ directions, two @ directions
        own: FloatArray = np.sum(one**2, axis=0) * np.sum(two**2, axis=0)
        shared: FloatArray = np.sum(one * two, axis=0)
        told: FloatArray = directions[:, shared > _TOLD * np.sqrt(own)]
        return told

    def fixed_slopes(self, where: BoolArray) -> FloatArray:
        """What a displacement does to the difference (N, 2), by the slopes of the fixed surface.

        As ``Σ ∂m (f − m)`` changes by ``Σ ∂m ∂f`` when m is displaced, and as the noise of one
        surface has nothing to do with the slopes of the other, this is what the data know; squares
        of one surface's slopes hold its noise.
        """
        slope_x, slope_y = _slopes(self.fields.fixed)
        slopes = np.stack([slope_x[where], slope_y[where]], axis=1)
        partials: FloatArray = -slopes / self.fields.sigma[where][:, None]
        return partials

    def linearised(
        self, shift: FloatArray, told: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
        """Partials (N, K + 3) by displacements along `told` (2, K) and by the plane, over sigma.

        With them the differences (N,) over sigma, where these points are, and the moved surface.
        """
        fields = self.fields
        moved, slope_x, slope_y, held = _displaced(
            self.coefficients, fields.moving_known, shift[0], shift[1]
        )
        compared = fields.fixed_known & held
        share = 1.0 / fields.sigma[compared]
        slopes = np.stack([slope_x[compared], slope_y[compared]], axis=1)
        rows = np.concatenate([-slopes @ told, self.plane[compared]], axis=1)
        rows *= share[:, None]
        return rows, (fields.fixed - moved)[compared] * share, compared, moved


@dataclass(frozen=True, eq=False)
class _Step:
    estimate: FloatArray  # (K + 3,) displacement along K directions, and plane
    spread: float  # robust standard deviation of what is left

    @property
    def moved(self) -> FloatArray:
        return self.estimate[:-3]

    @property
    def plane(self) -> FloatArray:
        return self.estimate[-3:]


def _robust_step(rows: FloatArray, difference: FloatArray, before: _Step) -> _Step:
    """Two re-weightings, from the weights that the plane of the step before leaves."""
    estimate, spread = np.zeros(rows.shape[1]), before.spread
    estimate[-3:] = before.plane
    if spread == 0.0:
        estimate[-3] = np.median(difference / rows[:, -3])
    for _ in range(2):
        left = difference - rows @ estimate
        spread = _spread(left)
        weighted = rows if spread <= 1e-12 else rows * huber_weight(left / spread)[:, None]
        estimate[:] = np.linalg.solve(weighted.T @ rows, weighted.T @ difference)
    return _Step(estimate, spread)


def _spread(left: FloatArray) -> float:
    """Robust standard deviation of finite values (N,)."""
    half = len(left) // 2
    away = np.abs(left - np.partition(left, half)[half])
    return MAD_TO_SIGMA * float(np.partition(away, half)[half])


@kernel
def _displaced(
    coefficients: FloatArray, known: BoolArray, shift_x: float, shift_y: float
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Cubic spline at ``(x − shift_x, y − shift_y)`` with its slopes, and where it is known.

    A displacement that is alike everywhere needs one set of weights. The slopes are antisymmetric
    differences of the displaced heights and not the spline's own: its smoothing of noise depends on
    where between the points it is evaluated, and slopes that see that would draw the displacement
    to half a cell. By these a noise of the heights is not correlated with its slope.
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
    slope_x, slope_y = _slopes(value)
    return value, slope_x, slope_y, held


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
