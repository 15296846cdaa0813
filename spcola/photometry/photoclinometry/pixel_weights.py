"""Pixels of an image: what is expected of them, and how much each counts."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.compilation import compiled, compiled_sums


@compiled
def expect_pixels(sums: FloatArray, usable: BoolArray, least: float, used: BoolArray) -> None:
    """Divide sums over cells by their area, and fill `used`: pixels that can be compared.

    Parameters
    ----------
    sums : (3, H, W) ndarray
        Area of the cells in each pixel, and area times brightness and times half-lit cells. The
        last two are divided by it; NaN where cells do not fill the pixel.
    usable : (H, W) ndarray of bool
        Pixels between the image's thresholds.
    least : float
        Share of a pixel that cells have to fill.
    used : (H, W) ndarray of bool
    """
    for y in range(used.shape[0]):
        for x in range(used.shape[1]):
            # Without branches the loop is vectorised.
            area = sums[0, y, x] if sums[0, y, x] >= least else np.nan
            sums[1, y, x] /= area
            sums[2, y, x] /= area
            used[y, x] = usable[y, x] & (sums[1, y, x] > 0.0)


@compiled
def find_inner(expected: FloatArray, used: BoolArray, inner: BoolArray) -> int:
    """Fill `inner` (H, W): used pixels with expected neighbours on four sides; return how many."""
    count = 0
    for y in range(1, used.shape[0] - 1):
        for x in range(1, used.shape[1] - 1):
            across = expected[y, x + 1] - expected[y, x - 1]
            inner[y, x] = used[y, x] and np.isfinite(
                across + expected[y + 1, x] - expected[y - 1, x]
            )
            count += inner[y, x]
    return count


@compiled_sums
def fit_scale(pixels: FloatArray, expected: FloatArray, scale: float, limit: float) -> float:
    """Return λ of N pixels by least squares, with Cauchy's weights of relative residuals.

    A pixel whose residual is `limit` times its expected brightness without λ has half the weight;
    `scale` is the λ of the residuals.
    """
    above, below = 0.0, 0.0
    for k in range(pixels.size):
        ratio = (pixels[k] - scale * expected[k]) / (limit * expected[k])
        weighted = expected[k] / (1.0 + ratio * ratio)
        above += weighted * pixels[k]
        below += weighted * expected[k]
    return above / below


@compiled
def median_deviation(values: FloatArray) -> float:
    """Return the median absolute deviation of N > 0 known numbers from their median.

    As :func:`spcola.math.robust.mad`, without its factor, in half of the time.
    """
    rest = values.copy()
    middle = _median(rest)
    for k in range(rest.size):
        rest[k] = abs(values[k] - middle)
    return _median(rest)


@compiled
def _median(values: FloatArray) -> float:
    """Return the median of N > 0 known numbers, which are rearranged."""
    half = values.size // 2
    above = _select(values, half)
    if values.size % 2:
        return above
    below = values[0]
    for k in range(1, half):
        below = max(below, values[k])
    return 0.5 * (below + above)


@compiled
def _select(values: FloatArray, rank: int) -> float:
    """Return the number of a rank, from 0; smaller ones are moved before it (Hoare 1961).

    Numbers are swapped whether they are smaller or not: a branch that cannot be predicted takes
    longer.
    """
    first, after = 0, values.size
    while True:
        a, b, c = values[first], values[(first + after) // 2], values[after - 1]
        pivot = max(min(a, b), min(max(a, b), c))
        smaller = first
        for k in range(first, after):
            value = values[k]
            values[k], values[smaller] = values[smaller], value
            smaller += value < pivot
        if rank < smaller:
            after = smaller
            continue
        equal = smaller
        for k in range(smaller, after):
            value = values[k]
            values[k], values[equal] = values[equal], value
            # None of these is smaller; so it ends where some are NaN, too.
            equal += not value > pivot
        if rank < equal:
            return pivot
        first = equal


@compiled
def weigh_pixels(
    pixels: FloatArray,
    used: BoolArray,
    compared: tuple[FloatArray, FloatArray, FloatArray],
    known: tuple[float, float, float, float, int],
    out: FloatArray,
) -> None:
    """Fill `out` (H, W, 5) with what :func:`gather_cells` takes of each pixel.

    Outliers are down-weighted by Cauchy's weight, pixels at the edge of a shadow by the share of
    half-lit cells, all by the correlation of neighbours.

    Parameters
    ----------
    pixels : (H, W) ndarray
        Brightness.
    used : (H, W) ndarray of bool
        From :func:`find_inner`.
    compared : three (H, W) ndarrays
        Expected brightness without λ, area of the cells in each pixel, share of half-lit cells.
    known : scale, spread, dark, loss, block
        λ; relative error of a pixel; expected brightness below which the error falls no further;
        residual in its sigmas beyond which a pixel is down-weighted; pixels of the image along the
        side of one of these.
    out : (H, W, 5) ndarray
    """
    expected, area, edge = compared
    scale, spread, dark, loss, block = known
    # Residuals over their errors times Cauchy's weight, and the weights; 0 where not used.
    scores, weights = np.empty(used.shape), np.empty(used.shape)
    for y in range(used.shape[0]):
        for x in range(used.shape[1]):
            error = spread * scale * max(expected[y, x], dark)
            score = (pixels[y, x] - scale * expected[y, x]) / error
            factor = 1.0 / (1.0 + (score / loss) ** 2)
            scores[y, x] = factor * score if used[y, x] else 0.0
            weights[y, x] = factor / (error * error) if used[y, x] else 0.0
    common = _inflation(scores, used)
    for y in range(used.shape[0]):
        for x in range(used.shape[1]):
            own = out[y, x]
            if not used[y, x]:
                own[0] = own[1] = own[2] = own[3] = own[4] = 0.0
                continue
            share = weights[y, x] * (1.0 - edge[y, x]) ** 2 / (common * area[y, x])
            half = 0.5 * share * scale / block
            own[0] = share
            own[1] = share * (pixels[y, x] - scale * expected[y, x])
            own[2] = share * scale * expected[y, x]
            own[3] = half * (expected[y, x + 1] - expected[y, x - 1])
            own[4] = half * (expected[y + 1, x] - expected[y - 1, x])


@compiled
def _inflation(scores: FloatArray, used: BoolArray) -> float:
    """Return the factor on the variance of pixels because neighbours have common errors.

    It is one plus the correlations of `scores` (H, W), residuals over their errors times their
    weights, 0 where not used, with the eight neighbours.
    """
    square, count = _pairs(scores, used, 0, 0)
    if not square > 0.0:
        return 1.0
    total = 0.0
    # Right; below; below right; below left. The other four see the same pairs.
    for down, over in ((0, 1), (1, 0), (1, 1), (1, -1)):
        product, pairs = _pairs(scores, used, down, over)
        total += 2.0 * product / max(pairs, 1)
    return max(1.0, 1.0 + total * count / square)


@compiled_sums
def _pairs(scores: FloatArray, used: BoolArray, down: int, over: int) -> tuple[float, int]:
    """Return the sum of the products of pixels with a neighbour, and how many pairs are used.

    Pixels of the first and last columns are not.
    """
    total, count, after = 0.0, 0, used.shape[1] - 1
    for y in range(used.shape[0] - down):
        one, other = scores[y, 1:after], scores[y + down, 1 + over : after + over]
        near, far = used[y, 1:after], used[y + down, 1 + over : after + over]
        for x in range(one.size):
            total += one[x] * other[x]
            count += near[x] & far[x]
    return total, count
