"""One image against a surface: expected pixels, scale, weights, and its normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import cauchy_weight, mad
from spcola.photometry.photoclinometry.cell_pixels import (
    NUISANCES,
    Places,
    gather_cells,
    shade_cells,
    spread_cells,
)
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.surface import Surface

# Share of a pixel that seen cells have to fill.
_FILLED = 0.6
# Fewest pixels of an image: its scale and shift take three of them.
_FEWEST = 30
# Brightness relative to its mean below which the error of a pixel falls no further.
_DARK = 0.3
# Least-squares solutions of the scale, each with new weights.
_SCALE_ROUNDS = 3
# Most pixels for a spread: the median of so many is within 2 % of that of all.
_SAMPLE = 4000
# Twelve variances of a uniform distribution are its squared width.
_SQUARED_WIDTH = 12.0


@dataclass(frozen=True, eq=False)
class ImageState:
    """What is known of an image from round to round.

    Parameters
    ----------
    scale : float
        λ; NaN before the first round.
    gradient : (2,) ndarray
        Relative change of λ along the grid's x and y, from its centre to its edge: what the
        photometric function and unresolved roughness change over the grid.
    shift : (2,) ndarray
        Correction of sample and line, pixels.
    spread : float
        Robust standard deviation of its brightness about the expected one, relative; NaN before.
    """

    scale: float
    gradient: FloatArray
    shift: FloatArray
    spread: float

    @classmethod
    def unknown(cls) -> ImageState:
        """Return the state before the first round."""
        return cls(float("nan"), np.zeros(2), np.zeros(2), float("nan"))


@dataclass(frozen=True, eq=False)
class Compared:
    """Expected and observed pixels of a window (H, W).

    Attributes
    ----------
    used : (H, W) ndarray of bool
        Pixels that seen, known ground fills and that are between the thresholds.
    area : (H, W) ndarray
        Area of the cells in each pixel.
    expected : (H, W) ndarray
        Brightness without λ; NaN where ground does not fill the pixel.
    edge : (H, W) ndarray
        Share of cells that are partly in shadow.
    """

    used: BoolArray
    area: FloatArray
    expected: FloatArray
    edge: FloatArray

    @property
    def enough(self) -> bool:
        """Whether there are enough pixels."""
        return int(np.count_nonzero(self.used)) >= _FEWEST


@dataclass(frozen=True, eq=False)
class _Ground:
    """Places, visibility and brightness of the cells of a surface in an image."""

    places: Places
    seen: FloatArray
    lit: FloatArray
    shades: FloatArray


def _ground_in(
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    options: PhotoclinometryOptions,
    sun: FloatArray | None = None,
) -> _Ground:
    seen, lit = window.seen_and_lit(surface.height, surface.gsd)
    if sun is not None:
        lit = window.lit(surface.height, surface.gsd, sun)
    shades = np.empty((3, *seen.shape))
    shade_cells(
        int(options.function.code), options.function.packed, surface.slopes,
        window.sun if sun is None else sun, window.eye, window.phase, shades,
    )  # fmt: skip
    shades *= gain(state.gradient, seen.shape)
    return _Ground(window.places(surface.height, state.shift), seen, lit, shades)


def _compared(
    window: ImageWindow, surface: Surface, ground: _Ground, options: PhotoclinometryOptions
) -> Compared:
    """Spread the brightness of cells over the pixels of an image [16]."""
    lit = ground.lit
    layers = np.stack([surface.albedo * ground.shades[0] * lit, (lit > 0.0) & (lit < 1.0)])
    sums = np.zeros((3, *window.pixels.shape))
    u, v = ground.places[:2]
    blur = _SQUARED_WIDTH * options.psf_px**2
    spread_cells(u, v, window.facing, blur, ground.seen, layers, sums)
    filled = sums[0] >= _FILLED
    with np.errstate(invalid="ignore", divide="ignore"):
        expected, edge = np.where(filled, sums[1:] / sums[0], np.nan)
    return Compared(window.usable & (expected > 0.0), sums[0], expected, edge)


def gain(gradient: FloatArray, cells: tuple[int, ...]) -> FloatArray:
    """Return 1 plus a plane (R − 1, C − 1) of relative changes from the centre to the edge."""
    y, x = ((np.arange(size) * 2.0 + 1.0) / size - 1.0 for size in cells)
    return 1.0 + gradient[0] * x + gradient[1] * y[:, None]


def compare_image(
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    options: PhotoclinometryOptions,
    *,
    sun: FloatArray | None = None,
) -> Compared:
    """Return the pixels that an image should have, and which of them can be compared.

    Parameters
    ----------
    window : ImageWindow
    surface : Surface
    state : ImageState
    options : PhotoclinometryOptions
    sun : (3,) ndarray, optional
        Another direction of the Sun, along the grid's axes.
    """
    return _compared(window, surface, _ground_in(window, surface, state, options, sun), options)


def scaled(
    pixels: FloatArray, expected: FloatArray, state: ImageState, options: PhotoclinometryOptions
) -> ImageState:
    """Return a state with λ and spread of N pixels: least squares, outliers down-weighted."""
    scale = state.scale
    if not np.isfinite(scale):
        scale = float(np.median(pixels / expected))
    spread = state.spread if np.isfinite(state.spread) else 1.0
    step = -(-pixels.size // _SAMPLE)
    for _ in range(_SCALE_ROUNDS):
        error = scale * spread * expected
        weight = cauchy_weight((pixels - scale * expected) / error, options.loss_scale)
        scale = float(np.sum(weight * pixels * expected) / np.sum(weight * expected**2))
        spread = float(mad(pixels[::step] / (scale * expected[::step]) - 1.0))
        spread = max(spread, options.least_error)
    return replace(state, scale=scale, spread=spread)


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of all cells of a grid, summed over images [20, 21].

    Attributes
    ----------
    normal : (10, R − 1, C − 1) ndarray
        Upper triangle, row by row, for (∂h/∂x, ∂h/∂y, h, albedo) of each cell.
    right : (4, R − 1, C − 1) ndarray
    coupled : (K, 20, R − 1, C − 1) ndarray
        Products of these with the nuisance parameters of each of K images.
    nuisance : (K, 5, 6) ndarray
        Normal matrices and right-hand sides of these.
    """

    normal: FloatArray
    right: FloatArray
    coupled: FloatArray
    nuisance: FloatArray

    @classmethod
    def empty(cls, images: int, cells: tuple[int, int]) -> Sums:
        """Return sums over no image yet."""
        return cls(
            np.zeros((10, *cells)), np.zeros((4, *cells)),
            np.zeros((images, 4 * NUISANCES, *cells)),
            np.zeros((images, NUISANCES, NUISANCES + 1)),
        )  # fmt: skip


def add_image(
    sums: Sums,
    number: int,
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    options: PhotoclinometryOptions,
    *,
    cells: BoolArray | None = None,
    rescale: bool = True,
) -> ImageState:
    """Add the normal equations of an image to `sums`; return its state with new λ and spread.

    `cells` (R − 1, C − 1) are those whose equations are added, all if not given. Without `rescale`
    λ and the error of the pixels are those of the state; the spread that is returned is new.
    Pixels at the edge of a shadow are down-weighted by the share of half-lit cells, outliers by
    Cauchy's weight. The error of a pixel is the image's own spread: images that the model expresses
    less well, at low phase or high incidence, count less.
    """
    ground = _ground_in(window, surface, state, options)
    compared = _compared(window, surface, ground, options)
    by_line, by_sample = _gradient(compared.expected)
    used = compared.used & np.isfinite(by_line + by_sample)
    if np.count_nonzero(used) < _FEWEST:
        return replace(state, spread=float("nan"))
    pixels, expected = window.pixels[used], compared.expected[used]
    found = scaled(pixels, expected, state, options)
    state = found if rescale else state
    scale = state.scale
    error = state.spread * scale * np.maximum(expected, _DARK * expected.mean())
    residual = pixels - scale * expected
    factor = cauchy_weight(residual / error, options.loss_scale)
    scores = np.full(window.pixels.shape, np.nan)
    scores[used] = factor * residual / error
    weight = factor / (error**2 * _inflation(scores))
    share = weight * (1.0 - compared.edge[used]) ** 2 / compared.area[used]
    terms = np.stack(
        [residual, *(scale * one for one in (expected, by_sample[used], by_line[used]))]
    )
    weighted = np.zeros((*window.pixels.shape, 5))
    weighted[used] = np.vstack([share, share * terms]).T
    partials = (
        scale
        * ground.lit
        * np.stack(
            [surface.albedo * ground.shades[1], surface.albedo * ground.shades[2], ground.shades[0]]
        )
    )
    seen = ground.seen if cells is None else np.where(cells, ground.seen, 0.0)
    seeing = window.facing, _SQUARED_WIDTH * options.psf_px**2, seen
    into = sums.normal, sums.right, sums.coupled[number], sums.nuisance[number]
    gather_cells(ground.places, seeing, weighted, partials, into)
    return replace(state, spread=found.spread)


def _inflation(scores: FloatArray) -> float:
    """Return the factor on the variance of pixels because neighbours have common errors.

    It is one plus the correlations of `scores` (H, W), residuals over their errors times their
    weights, with the eight neighbours; NaN at pixels that are not used.
    """
    known = np.isfinite(scores)
    layer = np.where(known, scores, 0.0)
    square = float(np.sum(layer**2)) / np.count_nonzero(known)
    total = 0.0
    for down, over in ((0, 1), (1, 0), (1, 1), (1, -1)):
        moved = np.roll(layer, (-down, -over), (0, 1))
        both = known & np.roll(known, (-down, -over), (0, 1))
        total += 2.0 * float(np.sum(layer * moved)) / max(int(np.count_nonzero(both)), 1)
    return max(1.0, 1.0 + total / square) if square > 0.0 else 1.0


def _gradient(layer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return central differences (H, W) along lines and samples; NaN at edges and gaps."""
    by_line, by_sample = np.full((2, *layer.shape), np.nan)
    by_line[1:-1] = 0.5 * (layer[2:] - layer[:-2])
    by_sample[:, 1:-1] = 0.5 * (layer[:, 2:] - layer[:, :-2])
    return by_line, by_sample
