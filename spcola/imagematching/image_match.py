"""Match of an ortho-image with a rendering of the same ground, to a fraction of a cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.grids.correlation import independent_patches, shift_correlations
from spcola.grids.gaps import carried_on
from spcola.grids.robust_covariance import huber_scores, robust_covariance
from spcola.math.robust import huber_solution, mad
from spcola.photometry import OrthoImage

# Smallest number of independent differences: twice the parameters of a match.
_MIN_PATCHES = 12.0
# Peaks of the correlation within so many cells count as one.
_APART = 3.0
# Largest distance of the fine match from the best whole cell, steps; beyond, it is another peak.
_FARTHEST = 3.0
_CONVERGED = 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True)
class ImageMatchOptions:
    """Settings of the match of an ortho-image and a rendering.

    Parameters
    ----------
    capture_cells : float
        Largest shift that is searched, grid steps.
    min_points : int
        Smallest number of lit points, and of compared points.
    min_correlation : float
        Smallest correlation, planes removed, after the match.
    ambiguity : float
        A second peak of the correlation makes the match ambiguous if ``1 − r²`` there is less
        than this multiple of that at the first.
    max_iterations : int
        Most Gauss–Newton steps.
    """

    capture_cells: float = 4.0
    min_points: int = 300
    min_correlation: float = 0.5
    ambiguity: float = 1.1
    max_iterations: int = 20


@dataclass(frozen=True, eq=False)
class ImageMatch:
    """Shift between an image and the rendering of its ground.

    Attributes
    ----------
    image : str
    shift : (2,) ndarray
        (x, y), grid steps: the image shows at x + shift what the rendering has at x. NaN if not
        matched.
    covariance : (2, 2) ndarray
        Covariance of the shift, from the autocorrelation of the remaining differences.
    correlation : float
        Correlation after the match, planes removed.
    points : int
        Number of compared points.
    reason : str
        Empty if the match is good, else why it must not be used.
    """

    image: str
    shift: FloatArray
    covariance: FloatArray
    correlation: float
    points: int
    reason: str = ""

    @property
    def usable(self) -> bool:
        """Whether it may be used."""
        return not self.reason


def match_image(
    ortho: OrthoImage, rendered: FloatArray, *, options: ImageMatchOptions | None = None
) -> ImageMatch:
    """Match an ortho-image with the brightness rendered of its view.

    ``ortho(x + d) = g rendered(x) + o + a·x + error`` with gain g, offset o and plane a as
    nuisances: the best whole-cell d by normalised correlation, then Gauss–Newton with Huber's
    weights. Shadows, rendered or observed, and the points next to them are left out: their length
    depends on relief finer than the grid, which biases the match away from the Sun.

    Parameters
    ----------
    ortho : OrthoImage
    rendered : (R, C) ndarray
        Relative brightness; NaN where unknown.
    options : ImageMatchOptions, optional

    Returns
    -------
    ImageMatch
        With NaN shift and a reason where no reliable match was found.
    """
    options = options or ImageMatchOptions()
    name, known = ortho.view.image, np.isfinite(rendered) & _clear(ortho.view.lit)
    shown = np.isfinite(ortho.brightness) & _clear(ortho.exposed | ~ortho.view.seen)
    rendered = np.where(known, rendered, np.nan)
    both = known & shown
    lit = int(np.count_nonzero(both))
    if lit < options.min_points:
        return _unmatched(name, f"shows only {lit} lit points of it")
    shown_flat, known_flat = _flattened(ortho.brightness, both), _flattened(rendered, both)
    textured = _textured(ortho.brightness, shown_flat, both)
    if not (textured and _textured(rendered, known_flat, both)):
        return _unmatched(name, "has no texture there")
    pair = _Pair(
        carried_on(np.where(shown, ortho.brightness, np.nan)), shown, carried_on(rendered), known
    )
    reach = max(1, int(np.ceil(options.capture_cells)))
    correlation = shift_correlations(
        np.where(known, known_flat, 0.0), known, np.where(shown, shown_flat, 0.0), shown,
        reach=reach,
    )  # fmt: skip
    start, reason = _best(correlation, reach, options)
    if reason:
        return _unmatched(name, reason)
    return _refined(name, pair, start, options)


def _clear(mask: BoolArray) -> BoolArray:
    """Return `mask` (R, C) without the points next to one outside it."""
    return ndimage.binary_erosion(mask, np.ones((3, 3), dtype=np.bool_), border_value=1)


@dataclass(frozen=True, eq=False)
class _Pair:
    """Ortho-image and rendering, with filled gaps for spline interpolation."""

    shown: FloatArray
    shown_mask: BoolArray
    rendered: FloatArray
    rendered_mask: BoolArray


def _textured(layer: FloatArray, flat: FloatArray, mask: BoolArray) -> bool:
    """Return whether a layer less its plane, `flat`, exceeds rounding over `mask`."""
    return float(np.std(flat[mask])) > _ROUNDING * float(np.max(np.abs(layer[mask])))


def _flattened(layer: FloatArray, mask: BoolArray) -> FloatArray:
    """Return a layer less its plane over `mask`: slow shading must not dominate."""
    rows, columns = np.indices(layer.shape)
    design = np.stack([np.ones(layer.shape), columns, rows], axis=-1) / layer.shape[0]
    plane = np.linalg.lstsq(design[mask], layer[mask], rcond=None)[0]
    return layer - design @ plane


def _best(
    correlation: FloatArray, reach: int, options: ImageMatchOptions
) -> tuple[FloatArray, str]:
    """Return the whole-cell shift (x, y) of the best correlation, or why there is none."""
    nowhere = np.full(2, np.nan)
    if not np.isfinite(correlation).any():
        return nowhere, "has no texture there"
    row, column = np.unravel_index(int(np.nanargmax(correlation)), correlation.shape)
    start = np.array([column - reach, row - reach], dtype=np.float64)
    if max(abs(start)) == reach > 1:
        return nowhere, "matches best at the edge of the capture range"
    best = float(correlation[row, column])
    filled = np.where(np.isfinite(correlation), correlation, -1.0)
    peaks = np.argwhere(ndimage.maximum_filter(filled, size=5, mode="nearest") == filled)
    away = np.hypot(peaks[:, 0] - row, peaks[:, 1] - column)
    others = filled[tuple(peaks[away > _APART].T)]
    # At sub-cell resolution the best peak is higher than at its whole cell: the others are too.
    if others.size and 1.0 - max(others.max(), 0.0) ** 2 < options.ambiguity * (1.0 - best**2):
        return nowhere, "shows two places alike"
    return start, ""


def _refined(name: str, pair: _Pair, start: FloatArray, options: ImageMatchOptions) -> ImageMatch:
    """Gauss–Newton on the resampled ortho-image."""
    size = pair.shown.shape
    coefficients = ndimage.spline_filter(pair.shown, order=3)
    holes = (~pair.shown_mask).astype(np.float64)
    y, x = np.indices(size).astype(np.float64)
    nuisance = [
        pair.rendered,
        np.ones(size),
        (x - size[1] / 2) / size[1],
        (y - size[0] / 2) / size[0],
    ]
    shift, converged, iterations = start.copy(), False, 0
    while not converged and iterations < options.max_iterations:
        iterations += 1
        where = np.stack([y + shift[1], x + shift[0]])
        shown = ndimage.map_coordinates(
            coefficients, where, order=3, prefilter=False, mode="nearest"
        )
        hole = ndimage.map_coordinates(holes, where, order=1, mode="constant", cval=1.0)
        compared = pair.rendered_mask & (hole < 1e-6)
        if np.count_nonzero(compared) < options.min_points:
            return _unmatched(name, f"shows only {np.count_nonzero(compared)} points of it")
        by_y, by_x = np.gradient(shown)
        design = np.stack([-by_x, -by_y, *nuisance], axis=-1)
        found = huber_solution(design[compared], shown[compared])
        if found is None:
            return _unmatched(name, "has no texture there")
        solution, _ = found
        shift = shift + np.clip(solution[:2], -1.0, 1.0)
        converged = bool(np.max(np.abs(solution[:2])) < _CONVERGED)
    if not converged or float(np.hypot(*(shift - start))) > _FARTHEST:
        return _unmatched(name, "the match does not converge")
    return _judged(name, shift, (shown, design, compared), solution, options)


def _judged(
    name: str,
    shift: FloatArray,
    compared: tuple[FloatArray, FloatArray, BoolArray],
    solution: FloatArray,
    options: ImageMatchOptions,
) -> ImageMatch:
    """Return the converged match, with a reason if it is not reliable.

    `compared` are the shifted ortho-image, the partials and the mask where both are known.
    """
    shown, design, mask = compared
    residual = np.full(shown.shape, np.nan)
    residual[mask] = (shown - design @ solution)[mask]
    correlation = _correlation(shown, design[..., 2:] @ solution[2:], mask)
    correlation *= float(np.sign(solution[2]))
    patches = independent_patches(residual)
    rows = np.moveaxis(np.where(mask[..., None], design, 0.0), -1, 0)
    scores = huber_scores(residual, float(mad(residual)))
    covariance = robust_covariance(rows, scores).matrix[:2, :2]
    if not correlation >= options.min_correlation:
        return _unmatched(name, f"correlates by {correlation:.2f} only")
    if patches < _MIN_PATCHES or not np.isfinite(covariance).all():
        return _unmatched(name, f"only {patches:.0f} of its differences are independent")
    return ImageMatch(name, shift, covariance, correlation, int(np.count_nonzero(mask)))


def _correlation(one: FloatArray, other: FloatArray, mask: BoolArray) -> float:
    """Return the correlation of two layers, planes removed."""
    a, b = _flattened(one, mask)[mask], _flattened(other, mask)[mask]
    scale = np.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / scale if scale > 0 else 0.0


def _unmatched(name: str, reason: str) -> ImageMatch:
    """Return a match that only has a reason for its failure."""
    nan = float("nan")
    return ImageMatch(name, np.full(2, nan), np.full((2, 2), nan), nan, 0, reason)
