"""Offset, correlation and silhouette of a frame against the rendered shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.imagematching.frames.rendered import RenderedFrame

# Least share of the frame in which both pictures overlap.
_LEAST_OVERLAP = 0.4
# The silhouette ends at this share of the brightness of bright ground above the sky: scattered
# light round a real body is fainter, though it may be above the shadow threshold.
_EDGE = 0.2
_BRIGHT = 95.0
# Sigma, in cells, of the smoothing before the offset is refined.
_SMOOTHING = 1.0
_NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]


@dataclass(frozen=True)
class FrameMatch:
    """How well a frame fits the rendered shape.

    Parameters
    ----------
    given : float
        Correlation without an offset.
    correlation : float
        Correlation at the best offset.
    offset : (2,) of float
        Pixel and line by which the image is displaced from the rendering.
    overlap, overlap_given : float
        Lit ground that both show over that which one shows (intersection over union), at the best
        offset and without one; NaN if neither shows any.
    """

    given: float
    correlation: float
    offset: tuple[float, float]
    overlap: float
    overlap_given: float


def compare_frame(
    pixels: AnyArray, rendered: RenderedFrame, *, lowest: float, reach_px: float
) -> FrameMatch:
    """Return the best offset of an image from the rendering, and how well they agree there.

    The correlation is that of the cells of both in their overlap (Padfield 2012, IEEE Trans. Image
    Process. 21, 2706, without masks). Its peak is refined to about 3 % of a cell, and 0.1 pixel.

    Parameters
    ----------
    pixels : (NLN, NPX) ndarray
    rendered : RenderedFrame
    lowest : float
        Lowest brightness of lit ground.
    reach_px : float
        Largest offset, pixels; where the correlation still rises there, half of the frame.
    """
    cells = block_means(pixels, rendered.step)
    scores = _correlations(cells, rendered.brightness, int(np.ceil(reach_px / rendered.step)))
    if _at_the_border(scores):
        scores = _correlations(cells, rendered.brightness, max(cells.shape) // 2)
    middle = scores.shape[0] // 2
    row, column = map(int, np.unravel_index(int(np.argmax(scores)), scores.shape))
    down, right = _refined(cells, rendered.brightness, (row - middle, column - middle))
    seen, expected = silhouette(cells, lowest), silhouette(rendered.brightness, 0.0)
    return FrameMatch(
        float(scores[middle, middle]),
        float(scores[row, column]),
        (right * rendered.step, down * rendered.step),
        silhouette_overlap(seen, expected, (row - middle, column - middle)),
        silhouette_overlap(seen, expected),
    )


def correlation_beyond(
    pixels: AnyArray, rendered: RenderedFrame, offset: tuple[float, float], *, distance_px: float
) -> float:
    """Return the largest correlation at offsets that are further than a distance from one.

    Where it is nearly that at the peak, the picture does not determine the offset: shading without
    detail that the shape has, or a limb along which the body may be moved.

    Parameters
    ----------
    pixels : (NLN, NPX) ndarray
    rendered : RenderedFrame
    offset : (2,) of float
        Pixel and line, of a :class:`FrameMatch`; offsets up to half of the frame are compared.
    distance_px : float
    """
    cells = block_means(pixels, rendered.step)
    scores = _correlations(cells, rendered.brightness, max(cells.shape) // 2)
    down, right = rendered.step * (np.indices(scores.shape) - scores.shape[0] // 2)
    far = np.hypot(right - offset[0], down - offset[1]) > distance_px
    return float(scores[far].max(initial=-1.0))


def silhouette(cells: FloatArray, lowest: float) -> BoolArray:
    """Return which cells (R, C) show lit ground.

    Those brighter than the sky by a fifth of what bright ground (the 95th percentile) is.

    Parameters
    ----------
    cells : (R, C) ndarray
        Brightness.
    lowest : float
        Cells above may be ground; the median of the others is the brightness of the sky.
    """
    ground, sky = cells[cells > lowest], cells[cells <= lowest]
    if not ground.size:
        return np.zeros(cells.shape, dtype=np.bool_)
    dark = float(np.median(sky)) if sky.size else 0.0
    edge = dark + _EDGE * (float(np.percentile(ground, _BRIGHT)) - dark)
    found: BoolArray = cells > edge
    return found


def silhouette_overlap(
    seen: BoolArray, expected: BoolArray, offset: tuple[int, int] = (0, 0)
) -> float:
    """Return intersection over union of two masks (R, C); NaN if both are empty.

    Parameters
    ----------
    seen, expected : (R, C) bool ndarray
    offset : (int, int)
        Rows and columns by which `seen` is displaced from `expected`.
    """
    one, other = _overlapping(seen, expected, offset)
    union = int(np.count_nonzero(one | other))
    return np.count_nonzero(one & other) / union if union else float("nan")


def block_means(pixels: AnyArray, step: int) -> FloatArray:
    """Return the means (R, C) of blocks of `step` × `step` pixels; the rest is left out."""
    rows, columns = pixels.shape[0] // step, pixels.shape[1] // step
    whole = pixels[: rows * step, : columns * step].reshape(rows, step, columns, step)
    means: FloatArray = whole.mean(axis=(1, 3), dtype=np.float64)
    return means


def _overlapping(
    one: AnyArray, other: AnyArray, offset: tuple[int, int]
) -> tuple[AnyArray, AnyArray]:
    """Return the parts of two arrays that lie on each other, the first displaced by an offset."""
    first, second = [], []
    for shift, size in zip(offset, one.shape, strict=True):
        first.append(slice(max(shift, 0), size + min(shift, 0)))
        second.append(slice(max(-shift, 0), size + min(-shift, 0)))
    return one[tuple(first)], other[tuple(second)]


def _correlations(image: FloatArray, model: FloatArray, reach: int) -> FloatArray:
    """Return correlations (2 K + 1, 2 K + 1) at offsets of −K to K rows and columns.

    −1 where too little overlaps or one of both is uniform.
    """
    reach = min(reach, *(size - 1 for size in image.shape))
    size = [fft.next_fast_len(length + reach, real=True) for length in image.shape]
    a, b = image - image.mean(), model - model.mean()
    ones = np.ones(image.shape)
    one, square_a, of_a = (fft.rfft2(part, size) for part in (ones, a * a, a))
    square_b, of_b = (np.conj(fft.rfft2(part, size)) for part in (b * b, b))
    rolled = np.arange(-reach, reach + 1)

    def at(product: AnyArray) -> FloatArray:
        whole = fft.irfft2(product, size)
        part: FloatArray = whole[np.ix_(rolled, rolled)]
        return part

    count = np.maximum(np.rint(at(one * np.conj(one))), 1.0)
    sum_a, sum_b = at(of_a * np.conj(one)), at(one * of_b)
    above = at(of_a * of_b) - sum_a * sum_b / count
    spread_a = np.maximum(at(square_a * np.conj(one)) - sum_a**2 / count, 0.0)
    spread_b = np.maximum(at(one * square_b) - sum_b**2 / count, 0.0)
    below = np.sqrt(spread_a * spread_b)
    enough = (count >= _LEAST_OVERLAP * image.size) & (below > 1e-9 * (image.size or 1))
    return np.where(enough, above / np.where(enough, below, 1.0), -1.0)


def _refined(image: FloatArray, model: FloatArray, near: tuple[int, int]) -> tuple[float, float]:
    """Return rows and columns at the peak of the correlation, less than two cells from `near`.

    Both are smoothed first: correlations of pictures with sharp edges have a cusp, which pulls the
    vertex of a parabola towards whole cells. Light from one side makes a ridge that runs
    obliquely, so that rows and columns are not to be refined one after the other.
    """
    one, other = (gaussian_filter(cells, _SMOOTHING, mode="nearest") for cells in (image, model))
    best, scores = near, np.zeros(9)
    for _ in range(2):
        around = [(best[0] + row, best[1] + column) for row, column in _NEIGHBOURS]
        scores = np.array([_correlation(*_overlapping(one, other, offset)) for offset in around])
        if (middle := int(np.argmax(scores))) == 4:
            break
        best = around[middle]
    step = _vertex(scores)
    return best[0] + step[0], best[1] + step[1]


def _correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of two arrays; −1 where one is uniform or empty."""
    if not one.size:
        return -1.0
    a, b = one - one.mean(), other - other.mean()
    below = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / below if below > 0.0 else -1.0


def _at_the_border(scores: FloatArray) -> bool:
    """Return whether the largest value of an array lies on its border: there is no peak inside."""
    return bool(scores.max() > scores[1:-1, 1:-1].max(initial=-1.0))


def _vertex(scores: FloatArray) -> tuple[float, float]:
    """Return row and column, at most one half each, of the vertex through scores (9,) of a peak."""
    row, column = np.array(_NEIGHBOURS, dtype=np.float64).T
    terms = np.stack([np.ones(9), row, column, row**2, column**2, row * column], axis=1)
    _, slope_r, slope_c, bend_r, bend_c, twist = np.linalg.lstsq(terms, scores, rcond=None)[0]
    bend = np.array([[2.0 * bend_r, twist], [twist, 2.0 * bend_c]])
    if not (bend_r < 0.0 and np.linalg.det(bend) > 0.0):
        return 0.0, 0.0
    down, right = np.clip(np.linalg.solve(bend, [-slope_r, -slope_c]), -0.5, 0.5)
    return float(down), float(right)
