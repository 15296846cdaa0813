"""Test whether lidar and SPC show the same relief where a transform places the lidar.

Two surfaces of one body at wrong places still have similar heights: both are round, and a match
always finds a minimum of the difference in its capture range. Only common relief is evidence. The
correlation of their relief is therefore compared with that of unrelated ground in the same search:
the same lidar surfaces over other maplets, rotated by multiples of 90°, mirrored, and shifted by
half a grid.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.grids.correlation import shift_correlations
from spcola.grids.gaps import bridged, trend_of

SHOWN = 4.0
"""Standard deviations of unrelated ground by which a significant correlation exceeds its mean."""
UNRELATED = 31
"""Ways in which a relief is rotated, mirrored and shifted to be unrelated to the ground below."""
# Standard deviation, cells, of the Gaussian that separates fine from coarse relief.
_FINE = 3.0
# Largest correlation, so that Fisher's z is finite.
_MOST = 0.9999
# Largest distance, cells, of the best correlation from the place that the transform gives: one is
# the step of the search, the rest the effect of noise on a broad maximum.
_MOST_APART = 2.5
# Share of the largest height: a smaller relief is rounding error.
_ROUNDING = 1e-12
# Points that both surfaces must have for their relief to be compared.
_LEAST_KNOWN = 100


class ReliefPair(NamedTuple):
    """Heights of lidar and SPC on one grid, and the lidar's displacement by the transform.

    Attributes
    ----------
    lidar, spc : (N, N) ndarray
        Metres along the grid's Uz; NaN where unknown.
    shift : (2,) ndarray
        Displacement of the lidar surface by the transform along x and y, cells; NaN if unknown.
    reach : int
        Largest displacement of the search, cells.
    noise : float
        Stated standard deviation of the difference of the two, metres; 0 if none is stated.
    """

    lidar: FloatArray
    spc: FloatArray
    shift: FloatArray
    reach: int
    noise: float = 0.0


@dataclass(frozen=True, eq=False)
class CommonRelief:
    """Significance with which mapolas and SPC surface show the same relief.

    Attributes
    ----------
    z_score : (N,) ndarray
        Correlation (Fisher's z) less the mean of unrelated ground, in standard deviations of
        unrelated ground; NaN where there is no relief above the noise.
    apart : (N,) ndarray
        Distance of the best correlation from the place that the transform gives, cells; NaN where
        one of them is not known.
    chance : float
        Share of unrelated pairs that pass the test.
    """

    z_score: FloatArray
    apart: FloatArray
    chance: float

    @property
    def shown(self) -> BoolArray:
        """Mask (N,) of the mapolas that show the relief of SPC where the transform places them."""
        near = np.isnan(self.apart) | (self.apart <= _MOST_APART)
        return (self.z_score > SHOWN) & near

    @property
    def compared(self) -> int:
        """Number of mapolas with relief to compare."""
        return int(np.isfinite(self.z_score).sum())

    @property
    def share(self) -> float:
        """Share of the compared mapolas that show the relief of SPC; NaN if none is compared."""
        return float(np.sum(self.shown)) / self.compared if self.compared else float("nan")


def common_relief(
    surfaces: Sequence[ReliefPair],
    each: Callable[[Callable[[_Case], _Significance], list[_Case]], Iterable[_Significance]] = map,
) -> CommonRelief:
    """Compare the relief of lidar and SPC with that of unrelated ground.

    Parameters
    ----------
    surfaces : sequence of ReliefPair
        Some two dozen suffice; the work grows with the square of their number.
    each : callable, optional
        Applies a function to each surface, as the built-in ``map``; others do it in parallel, or
        show progress.

    Returns
    -------
    CommonRelief
    """
    reliefs = [(_relief(one.lidar), _relief(one.spc)) for one in surfaces]
    of_spc = [spc for _, spc in reliefs]
    cases = [
        _Case(one, lidar, spc, of_spc[:number] + of_spc[number + 1 :])
        for number, (one, (lidar, spc)) in enumerate(zip(surfaces, reliefs, strict=True))
    ]
    found = list(each(_significance, cases))
    chance = float(np.mean(np.concatenate([one.by_chance for one in found]))) if found else 0.0
    z_score = np.array([one.z_score for one in found])
    apart = np.array([one.apart for one in found])
    return CommonRelief(z_score, apart, chance)


class _Relief(NamedTuple):
    """Whole and fine relief (2, N, N), metres, and the mask (N, N) of known points."""

    bands: FloatArray
    known: BoolArray

    @property
    def height(self) -> float:
        """Standard deviation of the whole relief, metres; 0 where nothing is known."""
        return float(np.std(self.bands[0][self.known])) if self.known.any() else 0.0


class _Case(NamedTuple):
    """A lidar surface with its relief, that of SPC there, and those of SPC elsewhere."""

    surface: ReliefPair
    lidar: _Relief
    spc: _Relief
    elsewhere: list[_Relief]


class _Significance(NamedTuple):
    """Of one surface: its z-score, its distance in cells, and which unrelated pairs pass."""

    z_score: float
    apart: float
    by_chance: BoolArray


class _Best(NamedTuple):
    """Fisher's z (2,) of the best correlation in each band, and its place (2, 2), x, y, cells."""

    fisher: FloatArray
    place: FloatArray


class _Scored(NamedTuple):
    """Z-scores (M,) of M pairs, each of the better of both bands, and their places (M, 2)."""

    z_score: FloatArray
    place: FloatArray


def _relief(height: FloatArray) -> _Relief:
    """Heights (N, N), metres, less their paraboloid, whole and high-pass filtered.

    The curvature of the body is not relief: every place has it.
    """
    known = np.isfinite(height)
    if np.count_nonzero(known) < _LEAST_KNOWN:
        return _Relief(np.zeros((2, *height.shape)), np.zeros(height.shape, dtype=bool))
    whole = bridged(height - trend_of(height))
    fine = whole - ndimage.gaussian_filter(whole, _FINE)
    bands = np.stack([whole, fine])
    bands -= np.mean(bands[:, known], axis=1)[:, None, None]
    # The rounding errors of a paraboloid are not relief.
    if np.std(bands[0][known]) < _ROUNDING * np.max(np.abs(height[known])):
        bands[:] = 0.0
    return _Relief(np.where(known, bands, 0.0), known)


def _significance(case: _Case) -> _Significance:
    """Compare one lidar surface with SPC, and with unrelated ground."""
    surface, lidar, spc, elsewhere = case
    pairs = [(lidar, spc), *((lidar, other) for other in elsewhere)]
    pairs += [(unrelated, spc) for unrelated in _unrelated(lidar)]
    found = _scored([_best(*pair, surface.reach) for pair in pairs])
    away = np.hypot(*(found.place - surface.shift).T)
    own = float(found.z_score[0])
    compared = own > SHOWN or lidar.height > surface.noise
    passed = (found.z_score[1:] > SHOWN) & ~(away[1:] > _MOST_APART)
    return _Significance(own if compared else float("nan"), float(away[0]), passed)


def _unrelated(relief: _Relief) -> list[_Relief]:
    """Return the relief rotated, mirrored and shifted by half its grid."""
    rows, columns = (size // 2 for size in relief.known.shape)
    made = []
    for mirrored in (False, True):
        for quarters in range(4):
            for down, right in ((0, 0), (rows, 0), (0, columns), (rows, columns)):
                if mirrored or quarters or down or right:
                    made.append(_rotated(relief, quarters, mirrored, (down, right)))
    return made


def _rotated(relief: _Relief, quarters: int, mirrored: bool, moved: tuple[int, int]) -> _Relief:
    bands, known = np.roll(relief.bands, moved, (-2, -1)), np.roll(relief.known, moved, (-2, -1))
    if mirrored:
        bands, known = bands[..., ::-1], known[..., ::-1]
    return _Relief(
        np.ascontiguousarray(np.rot90(bands, quarters, axes=(-2, -1))),
        np.ascontiguousarray(np.rot90(known, quarters, axes=(-2, -1))),
    )


def _best(lidar: _Relief, spc: _Relief, reach: int) -> _Best:
    """Find the best correlation of two reliefs within `reach` cells, in each band."""
    size = tuple(min(pair) for pair in zip(lidar.known.shape, spc.known.shape, strict=True))
    one, two = _middle(lidar, size), _middle(spc, size)
    fisher, places = np.full(2, np.nan), np.full((2, 2), np.nan)
    for band in range(2):
        correlation = shift_correlations(
            one.bands[band], one.known, two.bands[band], two.known, reach=reach
        )
        if np.isfinite(correlation).any():
            row, column = np.unravel_index(int(np.nanargmax(correlation)), correlation.shape)
            fisher[band] = np.arctanh(np.clip(correlation[row, column], -_MOST, _MOST))
            places[band] = column - reach, row - reach
    return _Best(fisher, places)


def _middle(relief: _Relief, size: tuple[int, ...]) -> _Relief:
    """Return the middle of a relief, `size` cells large."""
    start = [(full - part) // 2 for full, part in zip(relief.known.shape, size, strict=True)]
    rows, columns = (slice(at, at + part) for at, part in zip(start, size, strict=True))
    return _Relief(
        np.ascontiguousarray(relief.bands[:, rows, columns]),
        np.ascontiguousarray(relief.known[rows, columns]),
    )


def _scored(found: Sequence[_Best]) -> _Scored:
    """Z-score of each pair in the distribution of unrelated pairs, which are all but the first."""
    fisher = np.array([one.fisher for one in found])
    # Without relief all correlations are NaN, and so is the z-score.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        spread = np.nanstd(fisher[1:], axis=0)
        scaled = (fisher - np.nanmean(fisher[1:], axis=0)) / np.where(spread > 0, spread, np.nan)
    band = np.argmax(np.where(np.isnan(scaled), -np.inf, scaled), axis=1)
    place = np.array([one.place[k] for one, k in zip(found, band, strict=True)])
    return _Scored(scaled[np.arange(len(band)), band], place)
