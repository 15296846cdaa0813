"""Cells of a grid in the pixels of an image: expected brightness, and its normal equations.

A cell between four points is spread over pixels as a rectangle along lines and samples with the
second moments of its footprint: its share of a pixel is the product of two overlaps, so that no
polygons are needed. Blur of the image is applied to pixels, not here. What cells, even by
themselves, take from the contrast of the ground is given back (:func:`sharpen_cells`).
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.compilation import compiled, compiled_inline, compiled_sums
from spcola.photometry.functions import phase_terms, shade_at

# Places of the unknowns of a cell: slopes ∂h/∂x and ∂h/∂y, mean height (m), relative albedo.
UNKNOWNS = 4
# Nuisance parameters of an image: logarithm of its scale λ, changes of it along the grid's x and y
# (from the centre to the edge), shifts along samples and lines (px).
NUISANCES = 5
# With brightness added to the whole image, relative to its mean: errors of contrast. It is not
# estimated, and counts in sigmas.
WITH_CONTRAST = 6
# Numbers of a cell in one image: derivatives by the unknowns, and by those nuisance parameters
# from which the others follow. See :func:`gather_cells`.
FACTORS = UNKNOWNS + 4
_IN_FACTORS = (0, 1, 2, 3, 4, 7, 8, 9)
# Sums of a cell over its pixels, and numbers of the normal equations of its unknowns.
_TOTALS, EQUATIONS = 5, 14
# Share of the Laplacian that two means over a cell leave: a 24th each.
_SHARPENING = 1.0 / 12.0
# Smallest extent of a cell in the image, pixels: its centre lies in one pixel then.
_LEAST_EXTENT = 1e-6


@compiled
def box_cells(
    u: FloatArray,
    v: FloatArray,
    facing: float,
    seen: FloatArray,
    boxes: FloatArray,
) -> None:
    """Fill `boxes` (5, R − 1, C − 1): the rectangle of each cell in the pixels.

    First and last place along samples, those along lines, and the area of the cell's seen footprint
    over that of the rectangle: 0 where nothing is seen, and where the cell is folded over.

    Parameters
    ----------
    u, v : (R, C) ndarrays
        Sample and line of each point; pixel k of the window reaches from k to k + 1.
    facing : float
        Sign of the area of cells that face the camera.
    seen : (R − 1, C − 1) ndarray
        Share of each cell that the camera sees.
    boxes : (5, R − 1, C − 1) ndarray
    """
    for i in range(seen.shape[0]):
        u0, u1, v0, v1 = u[i], u[i + 1], v[i], v[i + 1]
        for j in range(seen.shape[1]):
            ax = 0.5 * (u0[j + 1] - u0[j] + u1[j + 1] - u1[j])
            ay = 0.5 * (v0[j + 1] - v0[j] + v1[j + 1] - v1[j])
            bx = 0.5 * (u1[j] - u0[j] + u1[j + 1] - u0[j + 1])
            by = 0.5 * (v1[j] - v0[j] + v1[j + 1] - v0[j + 1])
            x = 0.25 * (u0[j] + u0[j + 1] + u1[j] + u1[j + 1])
            y = 0.25 * (v0[j] + v0[j + 1] + v1[j] + v1[j + 1])
            width = max(np.sqrt(ax * ax + bx * bx), _LEAST_EXTENT)
            height = max(np.sqrt(ay * ay + by * by), _LEAST_EXTENT)
            area = max(facing * (ax * by - ay * bx), 0.0)
            boxes[0, i, j] = x - 0.5 * width
            boxes[1, i, j] = x + 0.5 * width
            boxes[2, i, j] = y - 0.5 * height
            boxes[3, i, j] = y + 0.5 * height
            boxes[4, i, j] = area * seen[i, j] / (width * height)


@compiled_inline
def _box(boxes: FloatArray, i: int, j: int) -> tuple[float, float, float, float, float]:
    return boxes[0, i, j], boxes[1, i, j], boxes[2, i, j], boxes[3, i, j], boxes[4, i, j]


@compiled_inline
def _reach(first: float, last: float, size: int) -> tuple[int, int]:
    """First of the pixels 0 … size − 1 that first … last reaches, and the one after the last."""
    return max(int(np.floor(first)), 0), min(int(np.ceil(last)), size)


@compiled_inline
def _overlap(first: float, last: float, pixel: int) -> float:
    """Length of first … last in pixel … pixel + 1."""
    return max(min(last, pixel + 1.0) - max(first, float(pixel)), 0.0)


@compiled_inline
def cell_offset(cell: int, cells: int) -> float:
    """Place of the middle of a cell from −1 to 1 along a side of the grid."""
    return (2.0 * cell + 1.0) / cells - 1.0


@compiled
def shade_cells(
    function: tuple[int, FloatArray],
    slopes: FloatArray,
    light: tuple[FloatArray, FloatArray, FloatArray],
    eye: FloatArray,
    gradient: FloatArray,
    shades: FloatArray,
) -> None:
    """Add to `shades` (3, R − 1, C − 1) irradiance times Φ, and derivatives by slopes [17 – 19].

    Parameters
    ----------
    function : int, (8,) ndarray
        Code and packed parameters of a photometric function.
    slopes : (2, R − 1, C − 1) ndarray
    light : three ndarrays
        (3,): unit vector to the source along the grid's axes; (R − 1, C − 1): phase, radians, and
        irradiance, that of the Sun being 1; known everywhere.
    eye : (3, R − 1, C − 1) ndarray
        Unit vectors to the camera, along the grid's axes.
    gradient : (2,) ndarray
        Relative change of all three along the grid's x and y, from its centre to its edge.
    shades : (3, R − 1, C − 1) ndarray
    """
    sun, phase, irradiance = light
    cells = phase.shape[1]
    steep, incidence, emission = np.empty(cells), np.empty(cells), np.empty(cells)
    value, by_i, by_e = np.empty(cells), np.empty(cells), np.empty(cells)
    # Three short loops along a row: the first and the last are vectorised.
    for i in range(phase.shape[0]):
        level = 1.0 + gradient[1] * cell_offset(i, phase.shape[0])
        for j in range(cells):
            x, y = slopes[0, i, j], slopes[1, i, j]
            steep[j] = 1.0 / np.sqrt(1.0 + x * x + y * y)
            incidence[j] = (sun[2] - x * sun[0] - y * sun[1]) * steep[j]
            emission[j] = (eye[2, i, j] - x * eye[0, i, j] - y * eye[1, i, j]) * steep[j]
        for j in range(cells):
            terms = phase_terms(function[0], function[1], phase[i, j])
            value[j], by_i[j], by_e[j] = shade_at(function[0], terms, incidence[j], emission[j])
        for j in range(cells):
            gain = (level + gradient[0] * cell_offset(j, cells)) * irradiance[i, j]
            turned = (by_i[j] * incidence[j] + by_e[j] * emission[j]) * steep[j]
            by_x = by_i[j] * sun[0] + by_e[j] * eye[0, i, j] + turned * slopes[0, i, j]
            by_y = by_i[j] * sun[1] + by_e[j] * eye[1, i, j] + turned * slopes[1, i, j]
            shades[0, i, j] += gain * value[j]
            shades[1, i, j] -= gain * steep[j] * by_x
            shades[2, i, j] -= gain * steep[j] * by_y


@compiled
def sharpen_cells(light: FloatArray, whole: FloatArray, sharp: FloatArray) -> None:
    """Fill `sharp` with the light of cells less a twelfth of its Laplacian.

    The slopes of a cell are means over it, and it is spread as an even rectangle: both average over
    a cell what a pixel would see. Two means over a width g change a wave as a twelfth of g² times
    the Laplacian does, to second order. Ground next to cells in shadow or hidden is not changed.
    Derivatives are those without it: the next round has what they miss.

    Parameters
    ----------
    light : (R − 1, C − 1) ndarray
    whole : (R − 1, C − 1) ndarray
        1 for cells that are seen and lit, 0 for others.
    sharp : (R − 1, C − 1) ndarray
    """
    rows, cells = light.shape
    for i in range(rows):
        here, out, counts = light[i], sharp[i], whole[i]
        # Beyond an edge is the cell itself: no difference.
        above, under = light[max(i - 1, 0)], light[min(i + 1, rows - 1)]
        counts_above, counts_under = whole[max(i - 1, 0)], whole[min(i + 1, rows - 1)]
        for j in range(cells):
            out[j] = counts_above[j] * (here[j] - above[j]) + counts_under[j] * (here[j] - under[j])
        for j in range(1, cells):
            out[j] += counts[j - 1] * (here[j] - here[j - 1])
        for j in range(cells - 1):
            out[j] += counts[j + 1] * (here[j] - here[j + 1])
        for j in range(cells):
            out[j] = here[j] + _SHARPENING * counts[j] * out[j]


@compiled
def spread_cells(boxes: FloatArray, light: FloatArray, lit: FloatArray, sums: FloatArray) -> None:
    """Add to `sums` (3, H, W) the area of cells in each pixel, their light and half-lit area.

    Parameters
    ----------
    boxes : (5, R − 1, C − 1) ndarray
        From :func:`box_cells`.
    light : (R − 1, C − 1) ndarray
        Brightness of each cell.
    lit : (R − 1, C − 1) ndarray
        Its share that is lit.
    sums : (3, H, W) ndarray
    """
    for i in range(lit.shape[0]):
        for j in range(lit.shape[1]):
            left, right, top, bottom, unit = _box(boxes, i, j)
            if not unit > 0.0:
                continue
            bright, partly = light[i, j], 0.0 < lit[i, j] < 1.0
            low, high = _reach(top, bottom, sums.shape[1])
            first, after = _reach(left, right, sums.shape[2])
            for y in range(low, high):
                across = unit * _overlap(top, bottom, y)
                for x in range(first, after):
                    part = across * _overlap(left, right, x)
                    sums[0, y, x] += part
                    sums[1, y, x] += part * bright
                    if partly:
                        sums[2, y, x] += part


@compiled
def gather_cells(
    boxes: FloatArray,
    lift: FloatArray,
    window: FloatArray,
    bright: tuple[FloatArray, FloatArray, FloatArray],
    level: float,
    sums: tuple[FloatArray, AnyArray, FloatArray],
) -> None:
    """Add the normal equations of one image, a term for each cell [20, 21].

    A pixel's residual r = I − Σ s m over its cells is linear in their unknowns. With the shares s
    of the cells in the pixel, which sum to 1, ``(r − Σ s j·x)² ≤ Σ s (r − j·x)²``: the right-hand
    side has the same value and gradient at x = 0 and no term that couples two cells. Minimised
    again and again it leads to the minimum of the left-hand side (De Pierro 1995).

    Parameters
    ----------
    boxes : (5, R − 1, C − 1) ndarray
        From :func:`box_cells`.
    lift : (2, R − 1, C − 1) ndarray
        Derivatives of sample and line of each cell by its height, pixels a metre.
    window : (H, W, 5) ndarray
        Weight 1/σ² over the area of all cells in a pixel, and its products with the residual, the
        expected brightness, and the derivatives of that along samples and lines of the image. All
        are 0 where a pixel does not count.
    bright : three ndarrays
        (R − 1, C − 1): brightness of a cell of albedo 1 and Φ = 1, and its albedo; (3, R − 1,
        C − 1): what :func:`shade_cells` gives.
    level : float
        Mean expected brightness of the image.
    sums : three ndarrays
        To the first and the last it is added; the second is filled.
        (14, R − 1, C − 1): upper triangle, row by row, of the normal matrix of (∂h/∂x, ∂h/∂y, h,
        albedo), then its right-hand side. (8, R − 1, C − 1): derivatives of the brightness by these
        four unknowns, and by ln λ, the shifts along samples and lines and the added brightness,
        each times the root of the weight: the products of the two are those of the unknowns with
        the image's nuisance parameters. (6, 7): normal matrix of these, and in the last column its
        right-hand side, over all cells.
    """
    own, factors, nuisance = sums
    upper = np.zeros((WITH_CONTRAST, WITH_CONTRAST + 1))
    totals = np.empty((_TOTALS, own.shape[2]))
    rows = np.empty((UNKNOWNS + WITH_CONTRAST, own.shape[2]))
    for i in range(own.shape[1]):
        _over_pixels(boxes, i, window, totals)
        _derive(totals, lift, bright, i, rows)
        rows[-1] = level
        _add_unknowns(totals, rows, i, own)
        _add_nuisances(totals, rows, upper)
        _fill_factors(totals, rows, i, factors)
    for a in range(WITH_CONTRAST):
        nuisance[a, WITH_CONTRAST] += upper[a, WITH_CONTRAST]
        for b in range(WITH_CONTRAST):
            nuisance[a, b] += upper[min(a, b), max(a, b)]


@compiled
def _over_pixels(boxes: FloatArray, i: int, window: FloatArray, totals: FloatArray) -> None:
    """Fill `totals` (5, C − 1): sums of the layers of a window over the rectangles of row `i`."""
    for j in range(totals.shape[1]):
        left, right, top, bottom, unit = _box(boxes, i, j)
        weight, pull, mean, by_u, by_v = 0.0, 0.0, 0.0, 0.0, 0.0
        if unit > 0.0:
            low, high = _reach(top, bottom, window.shape[0])
            first, after = _reach(left, right, window.shape[1])
            for y in range(low, high):
                across = unit * _overlap(top, bottom, y)
                for x in range(first, after):
                    part = across * _overlap(left, right, x)
                    weight += part * window[y, x, 0]
                    pull += part * window[y, x, 1]
                    mean += part * window[y, x, 2]
                    by_u += part * window[y, x, 3]
                    by_v += part * window[y, x, 4]
        totals[0, j], totals[1, j], totals[2, j] = weight, pull, mean
        totals[3, j], totals[4, j] = by_u, by_v


@compiled
def _derive(
    totals: FloatArray,
    lift: FloatArray,
    bright: tuple[FloatArray, FloatArray, FloatArray],
    i: int,
    rows: FloatArray,
) -> None:
    """Fill `rows` (10, C − 1): derivatives of the brightness of the cells of row `i`.

    By their four unknowns and all nuisance parameters but the last.
    """
    unit_bright, albedo, shades = bright
    count, cells = albedo.shape
    along_y = cell_offset(i, count)
    for j in range(cells):
        over = 1.0 / totals[0, j] if totals[0, j] > 0.0 else 0.0
        mean, by_u, by_v = totals[2, j] * over, -totals[3, j] * over, -totals[4, j] * over
        scale = unit_bright[i, j] * albedo[i, j]
        rows[0, j] = scale * shades[1, i, j]
        rows[1, j] = scale * shades[2, i, j]
        rows[2, j] = by_u * lift[0, i, j] + by_v * lift[1, i, j]
        rows[3, j] = unit_bright[i, j] * shades[0, i, j]
        rows[4, j] = mean
        rows[5, j] = mean * cell_offset(j, cells)
        rows[6, j] = mean * along_y
        rows[7, j] = by_u
        rows[8, j] = by_v


@compiled
def _add_unknowns(totals: FloatArray, rows: FloatArray, i: int, own: FloatArray) -> None:
    """Add the normal equations of the unknowns of the cells of row `i`.

    Each loop takes few arrays, so that it is vectorised.
    """
    cells, place = own.shape[2], 0
    weighted = np.empty(cells)
    for a in range(UNKNOWNS):
        for j in range(cells):
            weighted[j] = totals[0, j] * rows[a, j]
            own[EQUATIONS - UNKNOWNS + a, i, j] += totals[1, j] * rows[a, j]
        for b in range(a, UNKNOWNS):
            for j in range(cells):
                own[place, i, j] += weighted[j] * rows[b, j]
            place += 1


@compiled_sums
def _add_nuisances(totals: FloatArray, rows: FloatArray, upper: FloatArray) -> None:
    """Add the normal equations of the nuisance parameters, summed over a row of cells."""
    cells = rows.shape[1]
    weighted = np.empty(cells)
    for a in range(WITH_CONTRAST):
        pull = 0.0
        for j in range(cells):
            weighted[j] = totals[0, j] * rows[UNKNOWNS + a, j]
            pull += totals[1, j] * rows[UNKNOWNS + a, j]
        upper[a, WITH_CONTRAST] += pull
        for b in range(a, WITH_CONTRAST):
            product = 0.0
            for j in range(cells):
                product += weighted[j] * rows[UNKNOWNS + b, j]
            upper[a, b] += product


@compiled
def _fill_factors(totals: FloatArray, rows: FloatArray, i: int, factors: AnyArray) -> None:
    """Fill the factors of the cells of row `i`."""
    cells = rows.shape[1]
    root = np.sqrt(totals[0])
    for k in range(FACTORS):
        row = _IN_FACTORS[k]
        for j in range(cells):
            factors[k, i, j] = root[j] * rows[row, j]


@compiled_sums
def multiply_nuisances(factors: AnyArray, normal: FloatArray) -> None:
    """Fill `normal` (K, 6, 6): normal matrices of the nuisance parameters of K images.

    `factors` (K, 8, R − 1, C − 1) are those of :func:`gather_cells`, 0 in cells that do not count.
    """
    down, cells = factors.shape[2:]
    rows = np.empty((WITH_CONTRAST, cells))
    for k in range(factors.shape[0]):
        normal[k] = 0.0
        for i in range(down):
            for a in range(WITH_CONTRAST):
                own = factors[k, UNKNOWNS + max(a - 2, 0), i]
                for j in range(cells):
                    rows[a, j] = own[j]
            for j in range(cells):
                rows[1, j] *= cell_offset(j, cells)
                rows[2, j] *= cell_offset(i, down)
            for a in range(WITH_CONTRAST):
                for b in range(WITH_CONTRAST):
                    product = 0.0
                    for j in range(cells):
                        product += rows[a, j] * rows[b, j]
                    normal[k, a, b] += product
