"""How well images fit a surface, and how photoclinometry ended."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.arrays import FloatArray
from spcola.math.robust import mad
from spcola.photometry.photoclinometry.image_equations import (
    Compared,
    ImageState,
    compare_image,
    scaled,
)
from spcola.photometry.photoclinometry.image_window import ImageWindow
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.result import Fit, ImageFit, Outcome, Round, residual_change
from spcola.photometry.photoclinometry.surface import Surface
from spcola.photometry.photoclinometry.undetermined_axis import UndeterminedAxis

# With the Sun on the other side the correlation has to be higher by so much.
_REVERSED = 0.3
# Correlation below which an image shows something else.
_UNRELATED = 0.1
# Pixels from which on a correlation is judged.
_JUDGED = 300
# A result whose residual of brightness exceeds that of the start by this factor has diverged.
_WORSE = 1.0
# Standard deviation of second differences along lines and samples of white noise of 1.
_NOISE_OF_BOTH = 6.0
# Fewest of them for a standard deviation.
_FEWEST_NEIGHBOURS = 30
# Share of cells with both directions of the slope, or precise heights, below which the whole is
# not determined. On a synthetic body maplets near a pole had less than 0.12, all others over 0.5.
LEAST_DETERMINED = 0.25


def image_fits(
    names: Sequence[str],
    windows: Sequence[ImageWindow | None],
    surface: Surface,
    states: Sequence[ImageState],
    options: PhotoclinometryOptions,
) -> tuple[ImageFit, ...]:
    """Return how each image fits a surface.

    An image that does not correlate is compared again with the Sun turned by half a turn about the
    grid's normal: a sign of its direction may be wrong.
    """
    return tuple(
        ImageFit.not_seen(name) if window is None else _fit(window, surface, state, options)
        for name, window, state in zip(names, windows, states, strict=True)
    )


def _fit(
    window: ImageWindow, surface: Surface, state: ImageState, options: PhotoclinometryOptions
) -> ImageFit:
    compared = compare_image(window, surface, state, options)
    if not compared.enough:
        return ImageFit.not_seen(window.name)
    expected, pixels = compared.expected[compared.used], window.pixels[compared.used]
    state = scaled(pixels, expected, state, options)
    relative = np.full(window.pixels.shape, np.nan)
    relative[compared.used] = pixels / (state.scale * expected) - 1.0
    correlation, fit = _correlation(pixels, expected), Fit.USED
    if contradicts(correlation, len(pixels)):
        turned = compare_image(window.turned(), surface, state, options)
        fit = Fit.SUN_REVERSED if _fits_better(window, turned, correlation) else Fit.CONTRADICTS
    shift = (float(state.shift[0]), float(state.shift[1]))
    gradient = (float(state.gradient[0]), float(state.gradient[1]))
    return ImageFit(
        window.name, fit, state.scale, shift, state.spread, correlation, len(pixels), gradient,
        noise_of(relative), window.pixel_m(surface.gsd),
    )  # fmt: skip


def noise_of(residual: FloatArray) -> float:
    """Return the standard deviation of the part of residuals (H, W) that neighbours do not share.

    The differences of second differences along lines and samples contain neither slopes nor waves
    much longer than three pixels (Immerkær 1996). NaN with too few of them.
    """
    across = residual[:, 2:] - 2.0 * residual[:, 1:-1] + residual[:, :-2]
    both = across[2:] - 2.0 * across[1:-1] + across[:-2]
    known = both[np.isfinite(both)]
    return float(mad(known)) / _NOISE_OF_BOTH if known.size >= _FEWEST_NEIGHBOURS else float("nan")


def _fits_better(window: ImageWindow, turned: Compared, correlation: float) -> bool:
    """Whether pixels correlate better than before."""
    if not turned.enough:
        return False
    other = _correlation(window.pixels[turned.used], turned.expected[turned.used])
    return other > correlation + _REVERSED


def contradicts(correlation: float, pixels: int) -> bool:
    """Whether so many pixels of an image, so little correlated, show something else."""
    return correlation < _UNRELATED and pixels >= _JUDGED


def _correlation(one: FloatArray, other: FloatArray) -> float:
    """Return the correlation of two sets of brightnesses (N,); 0 if one is constant."""
    a, b = one - one.mean(), other - other.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0


def outcome_of(
    before: FloatArray,
    fits: Sequence[ImageFit],
    rounds: Sequence[Round],
    determined: float,
    axis: UndeterminedAxis,
    options: PhotoclinometryOptions,
) -> tuple[Outcome, str]:
    """Return how photoclinometry ended, and why in one clause.

    Parameters
    ----------
    before : (K,) ndarray
        Relative residuals of the images for the start surface.
    fits : sequence of ImageFit
    rounds : sequence of Round
    determined : float
        Share of the cells of which images determine both directions of the slope, or that have
        heights of a sigma below the GSD, 0 … 1.
    axis : UndeterminedAxis
        Of the cells of which images determine one direction.
    options : PhotoclinometryOptions
    """
    after = np.array([fit.residual for fit in fits])
    both = np.isfinite(after) & np.isfinite(before)
    last = rounds[-1]
    # Of ground that no image showed at the start nothing can have become worse.
    if np.isfinite(before).any() and not both.any():
        return Outcome.DIVERGED, "no image shows enough of the surface that was found"
    ratio = float(np.median(after[both] / before[both])) if both.any() else _WORSE
    if not ratio <= _WORSE:
        return Outcome.DIVERGED, f"the residual of brightness rose to {ratio:.2f} times the start's"
    if determined < LEAST_DETERMINED:
        return Outcome.UNDETERMINED, (
            "both directions of the slope are determined by images, or heights by constraints, in "
            f"only {determined:.0%} of the cells{_lacking(axis)}"
        )
    change = residual_change(rounds)
    settled = (
        last.height_m < options.settled_gsd * last.gsd
        and last.albedo < options.settled_albedo
        and change < options.settled_residual
    )
    residual = f"{change:.2g}" if np.isfinite(change) else "an unknown amount"
    changes = (
        f"changed by {last.height_m:.2g} m, albedo by {last.albedo:.2g} and the residual of "
        f"brightness by {residual} in the last"
    )
    if settled:
        return Outcome.CONVERGED, f"heights {changes} round"
    return Outcome.NOT_CONVERGED, f"heights still {changes} of {options.rounds} rounds"


def _lacking(axis: UndeterminedAxis) -> str:
    """Return along which axis slopes are not determined, as the end of a clause; or nothing."""
    if not axis.known:
        return ""
    return (
        f"; slopes along azimuth {axis.shown_azimuth} (from north to east) are not determined by "
        f"images in {axis.share:.0%} of the cells, those across it are"
    )
