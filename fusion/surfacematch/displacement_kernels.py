"""Compiled loops of the displacement of one surface against another: Gauss–Newton."""

from __future__ import annotations

import numpy as np

from fusion.surfacematch.spline import BORDER
from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled, compiled_sums
from spcola.math.robust import HUBER, MAD_TO_SIGMA, TUKEY

LEAST_POINTS = 30
"""Fewer points give no displacement."""

# Steps with Huber's weights before Tukey's, and steps that estimate the spread anew: spread and
# weights that depend on each other may cycle.
_ROUNDS_OF_HUBER, _ROUNDS_OF_SPREAD = 2, 5
# Every so many-th residual is used for the spread, which makes it accurate to some hundredths.
_SPREAD_STEP = 4
# Tolerance, cells, after _ROUNDS_OF_SPREAD steps.
_OSCILLATION = 5e-3


@compiled
def gauss_newton(
    layers: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    known: tuple[tuple[BoolArray, BoolArray], BoolArray],
    observable: FloatArray,
    level: float,
    start: FloatArray,
    limits: tuple[int, float],
) -> tuple[FloatArray, FloatArray, float, int, bool]:
    """Displace, linearise, re-weight and solve until the displacement converges.

    Returns shift (2,), plane (3,), spread, iterations (0 if too few points are common), converged.

    Parameters
    ----------
    layers : tuple
        The spline's coefficients, the fixed surface, sigma, the partials with respect to tilts.
    known : tuple
        Masks of the displaced surface (as in :func:`displaced`) and of the fixed one.
    observable : (2, K) ndarray
        Directions in which the displacement is estimated.
    level : float
        Gain of the whitening filter for a constant height; 1 without a filter.
    start : (2,) ndarray
        First displacement, cells.
    limits : (int, float)
        Most iterations, and the tolerance in cells.
    """
    coefficients, fixed, sigma, tilting = layers
    shift, along = start.copy(), observable.shape[1]
    estimate, spread = np.zeros(along + 3), 0.0
    for iteration in range(1, limits[0] + 1):
        moved, valid = displaced(coefficients, known[0], shift[0], shift[1])
        compared = (known[1] & valid).ravel()
        if np.count_nonzero(compared) < LEAST_POINTS:
            return shift, estimate[along:], spread, 0, False
        grids, apart = partial_layers(moved, (fixed, sigma, tilting), observable, level)
        rows, difference = grids.reshape(along + 3, -1), apart.ravel()
        estimate[:along] = 0.0
        if iteration == 1:
            estimate[along] = np.median(_every(difference / rows[along], compared, 1))
        for weighing in range(2 if iteration <= _ROUNDS_OF_HUBER else 1):
            residual = np.abs(difference - estimate @ rows)
            # About 0: the plane of the previous step has removed their median.
            if iteration == 1 or (weighing == 0 and iteration <= _ROUNDS_OF_SPREAD):
                sample = _every(residual, compared, _SPREAD_STEP if along else 1)
                spread = float(MAD_TO_SIGMA * np.median(sample))
            weight = _weights(residual, compared, spread, iteration > _ROUNDS_OF_HUBER)
            normal, right = weighted_products(weight, rows, difference)
            estimate = np.linalg.solve(normal, right)
        most = _move(shift, estimate, observable)
        # Where a displacement changes which points are compared, it oscillates by some thousandths
        # of a cell.
        enough = limits[1] if iteration <= _ROUNDS_OF_SPREAD else max(limits[1], _OSCILLATION)
        # A rough result does not need Tukey's weights.
        fewest = 2 if limits[1] > _OSCILLATION else _ROUNDS_OF_HUBER + 2
        if most < enough and iteration >= fewest:
            return shift, estimate[along:], spread, iteration, True
    return shift, estimate[along:], spread, limits[0], False


@compiled
def _move(shift: FloatArray, estimate: FloatArray, observable: FloatArray) -> float:
    """Move `shift` (2,) by up to one cell in each direction; return the largest step."""
    most = 0.0
    for axis in range(2):
        offset = 0.0
        for k in range(observable.shape[1]):
            offset += observable[axis, k] * min(max(estimate[k], -1.0), 1.0)
        shift[axis] += offset
        most = max(most, abs(offset))
    return most


@compiled
def _every(values: FloatArray, where: BoolArray, step: int) -> FloatArray:
    """Every `step`-th of the values (N,) at the points of a mask."""
    kept = np.empty(values.shape[0])
    count, passed = 0, step - 1
    for n in range(values.shape[0]):
        if where[n]:
            passed += 1
            if passed == step:
                kept[count], passed = values[n], 0
                count += 1
    return kept[:count]


@compiled
def _weights(
    residual: FloatArray, compared: BoolArray, spread: float, redescend: bool
) -> FloatArray:
    """Tukey's or Huber's weights of absolute residuals (N,); 0 where nothing was compared.

    All are 1 if the spread is 0. Boulders that SPC shortens all lie to one side, so that any weight
    of them would bias the height; but Tukey's weights need the good start that Huber's provide.
    """
    weight = np.empty(residual.shape[0])
    if spread <= 1e-12:
        weight[:] = compared
    elif redescend:
        for n in range(residual.shape[0]):
            ratio = min(residual[n] / (TUKEY * spread), 1.0)
            weight[n] = compared[n] * (1.0 - ratio * ratio) ** 2
    else:
        for n in range(residual.shape[0]):
            weight[n] = compared[n] * min(HUBER * spread / max(residual[n], 1e-300), 1.0)
    return weight


@compiled_sums
def weighted_products(
    weight: FloatArray, rows: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted sums (P, P) of products of layers (P, N), and (P,) of layers by values (N,)."""
    count = rows.shape[0]
    square, right = np.empty((count, count)), np.empty(count)
    for p in range(count):
        scaled = weight * rows[p]
        total = 0.0
        for n in range(values.shape[0]):
            total += scaled[n] * values[n]
        right[p] = total
        for q in range(p + 1):
            other, total = rows[q], 0.0
            for n in range(values.shape[0]):
                total += scaled[n] * other[n]
            square[p, q] = square[q, p] = total
    return square, right


@compiled
def partial_layers(
    moved: FloatArray,
    others: tuple[FloatArray, FloatArray, FloatArray],
    observable: FloatArray,
    level: float,
) -> tuple[FloatArray, FloatArray]:
    """Partials (K + 3, R, C) and differences (R, C) over sigma.

    `others` are the fixed surface, sigma, and the partials with respect to tilts along x and y
    (2, R, C). Slopes are antisymmetric differences of the displaced heights, not the spline's own:
    the spline's smoothing of noise depends on the sub-cell position, and its slopes would bias the
    displacement towards half a cell. Antisymmetric differences are uncorrelated with the noise of
    the heights.
    """
    height, width = moved.shape
    along = observable.shape[1]
    layers = np.empty((along + 3, height, width))
    difference = np.empty(moved.shape)
    fixed, sigma, tilting = others
    slope_x, slope_y = slopes_of(moved)
    for r in range(height):
        for c in range(width):
            share = 1.0 / sigma[r, c]
            difference[r, c] = share * (fixed[r, c] - moved[r, c])
            for k in range(along):
                slope = observable[0, k] * slope_x[r, c] + observable[1, k] * slope_y[r, c]
                layers[k, r, c] = -share * slope
            layers[along, r, c] = share * level
            layers[along + 1, r, c] = share * tilting[0, r, c]
            layers[along + 2, r, c] = share * tilting[1, r, c]
    return layers, difference


@compiled
def slope_moments(
    moved: FloatArray, partials: FloatArray, sigma: FloatArray, compared: BoolArray
) -> FloatArray:
    """Covariances (4, 4), times the number of points, of slopes over sigma at compared points.

    The four are the slopes of the displaced surface along x and y with reversed sign, then the two
    of `partials` (2, R, C).
    """
    slope_x, slope_y = slopes_of(moved)
    height, width = moved.shape
    layers, weight = np.empty((4, moved.size)), np.empty(moved.size)
    common = 0
    for r in range(height):
        for c in range(width):
            n = r * width + c
            layers[0, n] = -slope_x[r, c] / sigma[r, c]
            layers[1, n] = -slope_y[r, c] / sigma[r, c]
            layers[2, n], layers[3, n] = partials[0, r, c], partials[1, r, c]
            weight[n] = 1.0 if compared[r, c] else 0.0
            common += 1 if compared[r, c] else 0
    square, total = weighted_products(weight, layers, np.ones(moved.size))
    for p in range(4):
        for q in range(4):
            square[p, q] -= total[p] * total[q] / max(common, 1)
    return square


@compiled
def displaced(
    coefficients: FloatArray,
    known: tuple[BoolArray, BoolArray],
    shift_x: float,
    shift_y: float,
) -> tuple[FloatArray, BoolArray]:
    """Cubic spline at ``(x − shift_x, y − shift_y)``, and where it is known.

    `coefficients` are those of ``spline_coefficients``. `known` are two masks (R, C): points that
    are known, and points that are known or next to known ones. A value is known if its nearest
    point is in the first mask and all points around it are in the second. As the displacement is
    the same everywhere, one set of spline weights suffices.
    """
    rows, columns = known[0].shape
    i, j = int(np.floor(-shift_y)), int(np.floor(-shift_x))
    weight_y, weight_x = _spline(-shift_y - i), _spline(-shift_x - j)
    # Neighbours that a linear interpolation would use.
    down = 1 if -shift_y - i > 1e-9 else 0
    right = 1 if -shift_x - j > 1e-9 else 0
    lower = 1 if -shift_y - i > 0.5 else 0
    later = 1 if -shift_x - j > 0.5 else 0
    along = np.empty((coefficients.shape[0], columns))
    value = np.empty(known[0].shape)
    valid = np.zeros(known[0].shape, dtype=np.bool_)
    first, past = min(max(-1 - j, 0), columns), max(min(columns - j, columns), 0)
    for r in range(along.shape[0]):
        line = coefficients[r]
        for c in range(columns):
            if c < first or c >= past:
                along[r, c] = 0.0
                for n in range(4):
                    along[r, c] += weight_x[n] * line[_bordered(c + j + n - 1, columns)]
        for c in range(first, past):
            place = c + j + BORDER
            along[r, c] = (
                weight_x[0] * line[place - 1]
                + weight_x[1] * line[place]
                + weight_x[2] * line[place + 1]
                + weight_x[3] * line[place + 2]
            )
    for r in range(rows):
        above, here = along[_bordered(r + i - 1, rows)], along[_bordered(r + i, rows)]
        below, last = along[_bordered(r + i + 1, rows)], along[_bordered(r + i + 2, rows)]
        for c in range(columns):
            value[r, c] = (
                weight_y[0] * above[c]
                + weight_y[1] * here[c]
                + weight_y[2] * below[c]
                + weight_y[3] * last[c]
            )
        if r + i < 0 or r + i + down >= rows:
            continue
        nearest, near, next_to = known[0][r + i + lower], known[1][r + i], known[1][r + i + down]
        for c in range(max(0, -j), min(columns, columns - j - right)):
            both = near[c + j] & near[c + j + right]
            valid[r, c] = both & next_to[c + j] & next_to[c + j + right]
            valid[r, c] &= nearest[c + j + later]
    return value, valid


@compiled
def slopes_of(value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes of heights along x and along y, per cell."""
    slope_x, slope_y = np.empty(value.shape), np.empty(value.shape)
    for r in range(value.shape[0]):
        for c in range(value.shape[1]):
            slope_x[r, c] = _slope(value[r], c)
            slope_y[r, c] = _slope(value[:, c], r)
    return slope_x, slope_y


@compiled
def _slope(line: FloatArray, at: int) -> float:
    """Slope of a line of heights, per cell, from two neighbours on either side."""
    last = line.shape[0] - 1
    near = line[min(at + 1, last)] - line[max(at - 1, 0)]
    far = line[min(at + 2, last)] - line[max(at - 2, 0)]
    if 2 <= at <= last - 2:
        return (8.0 * near - far) / 12.0
    return near / (min(at + 1, last) - max(at - 1, 0))


@compiled
def _spline(t: float) -> FloatArray:
    """Weights (4,) of a cubic B-spline between its second and third coefficient."""
    u = 1.0 - t
    return np.array([u**3, 4 - 6 * t**2 + 3 * t**3, 4 - 6 * u**2 + 3 * u**3, t**3]) / 6.0


@compiled
def _bordered(index: int, size: int) -> int:
    """Index of a grid point's coefficient, limited to the border."""
    return min(max(index, -BORDER), size - 1 + BORDER) + BORDER
