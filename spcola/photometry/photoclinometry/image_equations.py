"""One image against a surface: expected pixels, scale, weights, and its normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.math.robust import MAD_TO_SIGMA
from spcola.photometry.photoclinometry.cell_pixels import (
    EQUATIONS,
    FACTORS,
    UNKNOWNS,
    WITH_CONTRAST,
    box_cells,
    gather_cells,
    multiply_nuisances,
    shade_cells,
    sharpen_cells,
    spread_cells,
)
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.pixel_weights import (
    expect_pixels,
    find_inner,
    fit_scale,
    median_deviation,
    weigh_pixels,
)
from spcola.photometry.photoclinometry.surface import Surface

# Share of a pixel that seen cells have to fill.
_FILLED = 0.6
# Fewest pixels of an image: its scale and shift take three of them.
_FEWEST = 30
# Least-squares solutions of a scale that is not known yet, each with new weights; one that is known
# is found anew in each round, with the spread of the one before.
_SCALE_ROUNDS = 3
# Most pixels for a spread: the median of so many is within 2 % of that of all.
_SAMPLE = 4000


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
    """Cells of a surface in an image: their seen rectangles, lit shares and brightness."""

    boxes: FloatArray
    lit: FloatArray
    shades: FloatArray


def _ground_in(
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    options: PhotoclinometryOptions,
) -> _Ground:
    seen, lit = window.seen_and_lit(surface)
    boxes, shades = np.empty((5, *seen.shape)), np.zeros((3, *seen.shape))
    u, v = window.places(surface.height, state.shift)
    box_cells(u, v, window.facing, seen, boxes)
    function = int(options.function.code), options.function.packed
    for light in window.lights():
        shade_cells(function, surface.slopes, light, window.eye, state.gradient, shades)
    return _Ground(boxes, lit, shades)


def _blurred(
    layers: FloatArray, window: ImageWindow, options: PhotoclinometryOptions, axes: tuple[int, int]
) -> FloatArray:
    """Return layers of pixels as the image blurs them; `axes` are lines and samples.

    What a cell gives to pixels through it, and what it takes from them, is the same. Beyond the
    window is no ground of the grid.
    """
    return options.blur_of(window.name).applied(layers, axes, block=window.block)


def _compared(
    window: ImageWindow, surface: Surface, ground: _Ground, options: PhotoclinometryOptions
) -> Compared:
    """Spread the brightness of cells over the pixels of an image [16]."""
    light = surface.albedo * ground.shades[0] * ground.lit
    whole = (ground.boxes[-1] > 0.0) & (ground.lit >= 1.0)
    sharp, sums = np.empty_like(light), np.zeros((3, *window.pixels.shape))
    sharpen_cells(light, whole.astype(np.float64), sharp)
    spread_cells(ground.boxes, sharp, ground.lit, sums)
    sums = _blurred(sums, window, options, (1, 2))
    used = np.zeros(window.pixels.shape, dtype=np.bool_)
    expect_pixels(sums, window.usable, _FILLED, used)
    return Compared(used, *sums)


def compare_image(
    window: ImageWindow,
    surface: Surface,
    state: ImageState,
    options: PhotoclinometryOptions,
) -> Compared:
    """Return the pixels that an image should have, and which of them can be compared.

    Parameters
    ----------
    window : ImageWindow
    surface : Surface
    state : ImageState
    options : PhotoclinometryOptions
    """
    return _compared(window, surface, _ground_in(window, surface, state, options), options)


def scaled(
    pixels: FloatArray, expected: FloatArray, state: ImageState, options: PhotoclinometryOptions
) -> ImageState:
    """Return a state with λ and spread of N pixels: least squares, outliers down-weighted."""
    scale, spread = state.scale, state.spread
    step = -(-pixels.size // _SAMPLE)
    some = pixels[::step] / expected[::step]
    new = not np.isfinite(scale + spread)
    if new:
        scale, spread = float(np.median(some)), 1.0
    for _ in range(_SCALE_ROUNDS if new else 1):
        scale = fit_scale(pixels, expected, scale, scale * spread * options.loss_scale)
        spread = max(MAD_TO_SIGMA * median_deviation(some) / abs(scale), options.least_error)
    return replace(state, scale=scale, spread=spread)


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of all cells of a grid, summed over K images [20, 21].

    Attributes
    ----------
    own : (14, R − 1, C − 1) ndarray
        Upper triangle, row by row, for (∂h/∂x, ∂h/∂y, h, albedo) of each cell, then the right-hand
        side.
    factors : (K, 8, R − 1, C − 1) ndarray of float32
        Derivatives by these unknowns and by the nuisance parameters of each image, over the error
        of the brightness, as :func:`gather_cells` has them.
    nuisance : (K, 6, 7) ndarray
        Normal matrices and right-hand sides of the nuisance parameters.
    """

    own: FloatArray
    factors: AnyArray
    nuisance: FloatArray

    @classmethod
    def empty(cls, images: int, cells: tuple[int, int]) -> Sums:
        """Return sums over no image yet."""
        return cls(
            np.zeros((EQUATIONS, *cells)),
            np.zeros((images, FACTORS, *cells), dtype=np.float32),
            np.zeros((images, WITH_CONTRAST, WITH_CONTRAST + 1)),
        )

    @property
    def normal(self) -> FloatArray:
        """Upper triangles (10, R − 1, C − 1) of the normal matrices."""
        return self.own[:-UNKNOWNS]

    @property
    def right(self) -> FloatArray:
        """Right-hand sides (4, R − 1, C − 1)."""
        return self.own[-UNKNOWNS:]

    def of_cells(self, chosen: BoolArray) -> Sums:
        """Return the sums over chosen cells (R − 1, C − 1) alone, for covariances.

        Right-hand sides of the nuisance parameters, which are not known by cell, are NaN.
        """
        factors, nuisance = self.factors * chosen, np.full_like(self.nuisance, np.nan)
        multiply_nuisances(factors, nuisance[..., :-1])
        return Sums(self.own * chosen, factors, nuisance)


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
    less well count less.
    """
    ground = _ground_in(window, surface, state, options)
    compared = _compared(window, surface, ground, options)
    used = np.zeros(window.pixels.shape, dtype=np.bool_)
    if find_inner(compared.expected, compared.used, used) < _FEWEST:
        return replace(state, spread=float("nan"))
    pixels, expected = window.pixels[used], compared.expected[used]
    found = scaled(pixels, expected, state, options)
    state = found if rescale else state
    weighted = np.empty((*window.pixels.shape, 5))
    mean = float(expected.mean())
    weigh_pixels(
        window.pixels, used, (compared.expected, compared.area, compared.edge),
        (state.scale, state.spread, options.least_brightness * mean, options.loss_scale,
         window.block), weighted,
    )  # fmt: skip
    weighted = _blurred(weighted, window, options, (0, 1))
    if cells is not None:
        ground.boxes[-1] *= cells
    bright = state.scale * ground.lit, surface.albedo, ground.shades
    lift = window.lift if options.stereo else np.zeros_like(window.lift)
    into = sums.own, sums.factors[number], sums.nuisance[number]
    gather_cells(ground.boxes, lift, weighted, bright, state.scale * mean, into)
    return replace(state, spread=found.spread)
