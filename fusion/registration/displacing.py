"""Kernels of the displacement of one surface against another: spline, slopes, Gauss–Newton."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.kernel import kernel
from spcola.robust import HUBER, MAD_TO_SIGMA, TUKEY

LEAST_POINTS = 30
"""Fewer points give no displacement."""

# Steps that weigh by Huber before Tukey may, and that take the spread anew: spread and weights
# that follow each other may go in circles.
_ROUNDS_OF_HUBER, _ROUNDS_OF_SPREAD = 2, 5
# Each so many-th residual tells the spread, to some hundredths.
_THINNED = 4
# Steps, cells, that are small enough after so many.
_TO_AND_FRO = 5e-3


@kernel
def gauss_newton(
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
        moved, held = displaced(coefficients, known[0], shift[0], shift[1])
        rows, difference = partial_rows(moved, fixed, sigma, known[1] & held, told, level)
        if rows.shape[0] < LEAST_POINTS:
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
def partial_rows(
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
def slope_moments(
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
def displaced(
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
def slopes_of(value: FloatArray) -> tuple[FloatArray, FloatArray]:
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
