"""Cells of a grid in the pixels of an image: expected brightness, and its normal equations.

A cell between four points is spread over pixels as a rectangle along lines and samples with the
second moments of its footprint and of the point spread: its share of a pixel is the product of two
overlaps, so that neither polygons nor convolutions are needed.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.compilation import compiled, compiled_inline
from spcola.photometry.functions import shade

Places = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Sample and line (R, C) of the points of a grid in a window, pixel k of which reaches from k to
k + 1, and the derivatives of sample and line in the image by height, pixels a metre."""
# Places of the unknowns of a cell: slopes ∂h/∂x and ∂h/∂y, mean height (m), relative albedo.
UNKNOWNS = 4
# Nuisance parameters of an image: logarithm of its scale λ, changes of it along the grid's x and y
# (from the centre to the edge), shifts along samples and lines (px).
NUISANCES = 5
# With brightness added to the whole image, relative to its mean: errors of contrast. It is not
# estimated, and counts in sigmas.
WITH_CONTRAST = 6
# Numbers of a cell in one image: see :func:`gather_cells`.
FACTORS = UNKNOWNS + 4
# Smallest extent of a cell in the image, pixels: its centre lies in one pixel then.
_LEAST_EXTENT = 1e-6


@compiled_inline
def _overlap(first: float, last: float, pixel: int) -> float:
    """Length of first … last in pixel … pixel + 1."""
    return max(min(last, pixel + 1.0) - max(first, float(pixel)), 0.0)


@compiled_inline
def _box(
    u: FloatArray, v: FloatArray, i: int, j: int, blur: float
) -> tuple[float, float, float, float, float]:
    """Return the first and last place of a cell's rectangle along samples, lines, and its area.

    The area, that of its footprint in pixels, is negative where the cell is folded over.
    """
    ax = 0.5 * (u[i, j + 1] - u[i, j] + u[i + 1, j + 1] - u[i + 1, j])
    ay = 0.5 * (v[i, j + 1] - v[i, j] + v[i + 1, j + 1] - v[i + 1, j])
    bx = 0.5 * (u[i + 1, j] - u[i, j] + u[i + 1, j + 1] - u[i, j + 1])
    by = 0.5 * (v[i + 1, j] - v[i, j] + v[i + 1, j + 1] - v[i, j + 1])
    x = 0.25 * (u[i, j] + u[i, j + 1] + u[i + 1, j] + u[i + 1, j + 1])
    y = 0.25 * (v[i, j] + v[i, j + 1] + v[i + 1, j] + v[i + 1, j + 1])
    half_x = 0.5 * max(np.sqrt(ax * ax + bx * bx + blur), _LEAST_EXTENT)
    half_y = 0.5 * max(np.sqrt(ay * ay + by * by + blur), _LEAST_EXTENT)
    return x - half_x, x + half_x, y - half_y, y + half_y, ax * by - ay * bx


@compiled
def shade_cells(
    code: int,
    packed: FloatArray,
    slopes: FloatArray,
    sun: FloatArray,
    eye: FloatArray,
    phase: FloatArray,
    shades: FloatArray,
) -> None:
    """Fill `shades` (3, R − 1, C − 1): Φ and its derivatives by both slopes [17 – 19].

    Parameters
    ----------
    code, packed : int, (8,) ndarray
        Of a photometric function.
    slopes : (2, R − 1, C − 1) ndarray
    sun : (3,) ndarray
        Unit vector along the grid's axes.
    eye : (3, R − 1, C − 1) ndarray
        Unit vectors to the camera, along the grid's axes.
    phase : (R − 1, C − 1) ndarray
        Radians.
    """
    for i in range(phase.shape[0]):
        for j in range(phase.shape[1]):
            x, y = slopes[0, i, j], slopes[1, i, j]
            square = 1.0 + x * x + y * y
            steep = 1.0 / np.sqrt(square)
            ex, ey, ez = eye[0, i, j], eye[1, i, j], eye[2, i, j]
            incidence = (sun[2] - x * sun[0] - y * sun[1]) * steep
            emission = (ez - x * ex - y * ey) * steep
            value, by_i, by_e = shade(code, packed, incidence, emission, phase[i, j])
            turned = (by_i * incidence + by_e * emission) / square
            shades[0, i, j] = value
            shades[1, i, j] = -(by_i * sun[0] + by_e * ex) * steep - turned * x
            shades[2, i, j] = -(by_i * sun[1] + by_e * ey) * steep - turned * y


@compiled
def spread_cells(
    u: FloatArray,
    v: FloatArray,
    facing: float,
    blur: float,
    seen: FloatArray,
    layers: FloatArray,
    sums: FloatArray,
) -> None:
    """Add to `sums` (1 + L, H, W) the area of cells in each pixel, and area times each layer.

    Parameters
    ----------
    u, v : (R, C) ndarrays
        Sample and line of each point; pixel k of the window reaches from k to k + 1.
    facing : float
        Sign of the area of cells that face the camera.
    blur : float
        Twelve times the variance of the point spread, pixels².
    seen : (R − 1, C − 1) ndarray
        Share of each cell that the camera sees.
    layers : (L, R − 1, C − 1) ndarray
    """
    height, width = sums.shape[1], sums.shape[2]
    for i in range(seen.shape[0]):
        for j in range(seen.shape[1]):
            if not seen[i, j] > 0.0:
                continue
            left, right, top, bottom, area = _box(u, v, i, j, blur)
            if not area * facing > 0.0:
                continue
            unit = area * facing * seen[i, j] / ((right - left) * (bottom - top))
            for y in range(max(int(np.floor(top)), 0), min(int(np.ceil(bottom)), height)):
                across = unit * _overlap(top, bottom, y)
                for x in range(max(int(np.floor(left)), 0), min(int(np.ceil(right)), width)):
                    part = across * _overlap(left, right, x)
                    sums[0, y, x] += part
                    for k in range(layers.shape[0]):
                        sums[1 + k, y, x] += part * layers[k, i, j]


@compiled_inline
def _over_pixels(
    window: FloatArray, box: tuple[float, float, float, float], unit: float
) -> tuple[float, float, float, float, float]:
    """Return the sums of the five layers of a window (H, W, 5) over a cell's rectangle.

    `unit` is the area of the cell over that of the rectangle.
    """
    first, last, top, bottom = box
    weight, pull, mean, by_u, by_v = 0.0, 0.0, 0.0, 0.0, 0.0
    left, right = max(int(np.floor(first)), 0), min(int(np.ceil(last)), window.shape[1])
    for y in range(max(int(np.floor(top)), 0), min(int(np.ceil(bottom)), window.shape[0])):
        across = unit * _overlap(top, bottom, y)
        for x in range(left, right):
            part = across * _overlap(first, last, x)
            weight += part * window[y, x, 0]
            pull += part * window[y, x, 1]
            mean += part * window[y, x, 2]
            by_u += part * window[y, x, 3]
            by_v += part * window[y, x, 4]
    return weight, pull, mean, by_u, by_v


@compiled
def gather_cells(
    places: Places,
    seeing: tuple[float, float, FloatArray, float],
    window: FloatArray,
    bright: tuple[FloatArray, FloatArray, FloatArray],
    sums: tuple[FloatArray, AnyArray, FloatArray],
) -> None:
    """Add the normal equations of one image, a term for each cell [20, 21].

    A pixel's residual r = I − Σ s m over its cells is linear in their unknowns. With the shares s
    of the cells in the pixel, which sum to 1, ``(r − Σ s j·x)² ≤ Σ s (r − j·x)²``: the right-hand
    side has the same value and gradient at x = 0 and no term that couples two cells. Minimised
    again and again it leads to the minimum of the left-hand side (De Pierro 1995).

    Parameters
    ----------
    places : four (R, C) ndarrays
        Sample and line of each point, and their derivatives by its height, pixels a metre.
    seeing : facing, blur, seen, level
        As in :func:`spread_cells`; mean expected brightness of the image.
    window : (H, W, 5) ndarray
        Weight 1/σ² over the area of all cells in a pixel, and its products with the residual, the
        expected brightness, and the derivatives of that along samples and lines of the image. All
        are 0 where a pixel does not count.
    bright : three ndarrays
        (R − 1, C − 1): brightness of a cell of albedo 1 and Φ = 1, and its albedo; (3, R − 1,
        C − 1): what :func:`shade_cells` gives.
    sums : three ndarrays
        To the first and the last it is added; the second is filled.
        (R − 1, C − 1, 14): upper triangle, row by row, of the normal matrix of (∂h/∂x, ∂h/∂y, h,
        albedo), then its right-hand side. (R − 1, C − 1, 8): derivatives of the brightness by these
        four unknowns, and by ln λ, the shifts along samples and lines and the added brightness,
        each times the root of the weight: the products of the two are those of the unknowns with
        the image's nuisance parameters. (6, 7): normal matrix of these, and in the last column its
        right-hand side, over all cells.
    """
    u, v, up_u, up_v = places
    facing, blur, seen, level = seeing
    unit_bright, albedo, shades = bright
    own, factors, nuisance = sums
    normal = np.zeros((WITH_CONTRAST, WITH_CONTRAST + 1))
    for i in range(seen.shape[0]):
        along_y = (2.0 * i + 1.0) / seen.shape[0] - 1.0
        for j in range(seen.shape[1]):
            factors[i, j] = 0.0
            if not seen[i, j] > 0.0:
                continue
            first, last, top, bottom, area = _box(u, v, i, j, blur)
            if not area * facing > 0.0:
                continue
            unit = area * facing * seen[i, j] / ((last - first) * (bottom - top))
            weight, pull, mean, by_u, by_v = _over_pixels(window, (first, last, top, bottom), unit)
            if not weight > 0.0:
                continue
            over, root = 1.0 / weight, np.sqrt(weight)
            mean, by_u, by_v = mean * over, -by_u * over, -by_v * over
            lift_u = 0.25 * (up_u[i, j] + up_u[i, j + 1] + up_u[i + 1, j] + up_u[i + 1, j + 1])
            lift_v = 0.25 * (up_v[i, j] + up_v[i, j + 1] + up_v[i + 1, j] + up_v[i + 1, j + 1])
            scale = unit_bright[i, j] * albedo[i, j]
            row = (
                scale * shades[1, i, j],
                scale * shades[2, i, j],
                by_u * lift_u + by_v * lift_v,
                unit_bright[i, j] * shades[0, i, j],
            )
            place = 0
            for a in range(UNKNOWNS):
                factors[i, j, a] = root * row[a]
                for b in range(a, UNKNOWNS):
                    own[i, j, place] += weight * row[a] * row[b]
                    place += 1
            for a in range(UNKNOWNS):
                own[i, j, place + a] += pull * row[a]
            factors[i, j, UNKNOWNS] = root * mean
            factors[i, j, UNKNOWNS + 1] = root * by_u
            factors[i, j, UNKNOWNS + 2] = root * by_v
            factors[i, j, UNKNOWNS + 3] = root * level
            along_x = (2.0 * j + 1.0) / seen.shape[1] - 1.0
            extra = (mean, mean * along_x, mean * along_y, by_u, by_v, level)
            for a in range(WITH_CONTRAST):
                weighted = weight * extra[a]
                for b in range(a, WITH_CONTRAST):
                    normal[a, b] += weighted * extra[b]
                normal[a, WITH_CONTRAST] += pull * extra[a]
    for a in range(WITH_CONTRAST):
        nuisance[a, WITH_CONTRAST] += normal[a, WITH_CONTRAST]
        for b in range(WITH_CONTRAST):
            nuisance[a, b] += normal[min(a, b), max(a, b)]
