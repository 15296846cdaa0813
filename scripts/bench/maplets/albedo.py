"""Albedo of maplets from images against the truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from real.printed import explained
from scipy import ndimage

from maplets.means import EDGE, albedo_of, mean_albedo, over_pixels
from spcola.grids import Maplet, MapletGrid
from spcola.heights.slopes import slopes_of
from spcola.math import Similarity
from spcola.photometry.ground import Ground
from spcola.truth.body import TruthBody

# Goals of the issue.
CORRELATION, TOPOGRAPHY = 0.9, 0.1
# Share of the points of a maplet that have to count.
LEAST_SHARE = 0.1


@dataclass(frozen=True)
class AlbedoErrors:
    """Of one maplet.

    Parameters
    ----------
    correlation, seen, of_means, of_pixels : float
        With the truth: of points, with its means over cells about them, of means over 3 x 3
        points, and of means over the median pixel.
    error, sigma : float
        Root mean square of the errors about their mean, and of their sigmas, where stated.
    within, within_two : float
        Shares of the errors within one and two sigmas.
    topography, true_topography : float
        Multiple correlation with both slopes; that of the true albedo with the true ones.
    """

    correlation: float
    seen: float
    of_means: float
    of_pixels: float
    error: float
    sigma: float
    within: float
    within_two: float
    topography: float
    true_topography: float


@dataclass(frozen=True, eq=False)
class TrueGround:
    """The truth on the grid of a maplet.

    Parameters
    ----------
    height : (R, C) ndarray
        Metres.
    albedo : (R, C) ndarray
        At the points.
    means : (R, C) ndarray
        Of the albedo, over squares of one GSD about the points.
    """

    height: np.ndarray
    albedo: np.ndarray
    means: np.ndarray

    @classmethod
    def of(cls, body: TruthBody, grid: MapletGrid, height: np.ndarray, where: Similarity) -> Self:
        """Return that of a body, given its heights on the grid and where the solution has it."""
        albedo = albedo_of(body, Ground.of(grid, height), where)
        return cls(height, albedo, mean_albedo(body, grid, where))


def albedo_errors(
    maplet: Maplet, sigma: np.ndarray, truth: TrueGround, good: np.ndarray, pixel: float
) -> AlbedoErrors | None:
    """Compare the albedo of a maplet where it is `good` (R, C); None if that is next to nowhere.

    `pixel` is the median of its images, metres.
    """
    gsd = maplet.grid.gsd
    good = good & np.isfinite(maplet.albedo) & np.isfinite(maplet.height)
    good[:EDGE], good[-EDGE:], good[:, :EDGE], good[:, -EDGE:] = False, False, False, False
    if good.mean() < LEAST_SHARE:
        return None
    own, right = maplet.albedo[good], truth.albedo[good]
    error = own / own.mean() - right / right.mean()
    coarse, coarse_true = (
        over_pixels(np.where(good, layer, np.nan), gsd, pixel)
        for layer in (maplet.albedo, truth.means)
    )
    whole = np.isfinite(coarse)
    return AlbedoErrors(
        correlation(own, right),
        correlation(own, truth.means[good]),
        correlation(means(maplet.albedo)[good], means(truth.albedo)[good]),
        correlation(coarse[whole], coarse_true[whole]),
        float(error.std()),
        *stated(error, sigma[good]),
        by_slopes(maplet.albedo, maplet.height, good, gsd),
        by_slopes(truth.albedo, truth.height, good, gsd),
    )


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Return the correlation of two arrays of the same shape."""
    return float(np.corrcoef(one, other)[0, 1])


def means(layer: np.ndarray) -> np.ndarray:
    """Return the means over 3 x 3 points of a layer (R, C), NaN next to unknown ones."""
    return ndimage.convolve(layer, np.full((3, 3), 1.0 / 9.0))


def stated(error: np.ndarray, sigma: np.ndarray) -> tuple[float, float, float]:
    """Return the root mean square of sigmas, and shares of errors within one and two, if known."""
    known = np.isfinite(sigma)
    if not known.any():
        return float("nan"), float("nan"), float("nan")
    pulls = np.abs(error[known]) / sigma[known]
    scatter = float(np.sqrt(np.mean(sigma[known] ** 2)))
    return scatter, float(np.mean(pulls < 1.0)), float(np.mean(pulls < 2.0))


def by_slopes(albedo: np.ndarray, height: np.ndarray, good: np.ndarray, gsd: float) -> float:
    """Return the multiple correlation of albedo with both slopes, where `good`; all (R, C)."""
    slopes = np.array(slopes_of(height, gsd))
    good = good & np.isfinite(slopes).all(axis=0)
    return explained(albedo[good], slopes[:, good])


def albedo_lines(of: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield what is printed of the albedo, from arrays over maplets."""
    middle, low = np.quantile(of["correlation"], [0.5, 0.1])
    yield (
        f"  albedo of {len(of['error'])}: correlation with the truth {middle:.3f} (median), "
        f"{low:.3f} (tenth), with its means over cells {np.median(of['seen']):.3f}, of means over "
        f"3 x 3 points {np.median(of['of_means']):.3f}, over a pixel "
        f"{np.median(of['of_pixels']):.3f} (goal {CORRELATION:g})"
    )
    error, sigma, one, two = (
        np.median(of[name]) for name in ("error", "sigma", "within", "within_two")
    )
    yield f"  its error {error:.4f}, sigma {sigma:.4f}, within one {one:.2f}, two {two:.2f}"
    own, true = (np.median(of[name]) for name in ("topography", "true_topography"))
    yield f"  with slopes {own:.3f}, the true albedo {true:.3f} (goal {TOPOGRAPHY:g})"
