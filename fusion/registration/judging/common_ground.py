"""Whether lidar and SPC show the same relief where a transform puts them, or chance alone.

Two surfaces of one body that are in the wrong places still look alike in height: both are round,
and a match in a small capture range always finds a place where they differ least. What they do not
have by chance is relief in common. The correlation of their relief is therefore compared with what
unrelated ground reaches in the same search: the same lidar surfaces over other maplets, turned by
quarters, mirrored, and shifted by half a grid.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from fusion.surfacematch.resolution import bridged, trend_of
from spcola.arrays import BoolArray, FloatArray
from spcola.grids.statistics import shift_correlations

SHOWN = 4.0
"""A correlation this many standard deviations above that of unrelated ground is not chance."""
# Standard deviation, cells, of the Gaussian that parts relief into fine and coarse.
_FINE = 3.0
# Surfaces that correlate fully are as sure as this: Fisher's z is finite.
_MOST = 0.9999
# Cells by which the best place may lie beside the one that the transform gives; one is the step of
# the search, the rest is what noise does to the place of a broad maximum.
_BESIDE = 2.5
# Of the largest height: less is what rounding leaves.
_ROUNDING = 1e-12
# Points that both surfaces must have for their relief to be compared.
_LEAST_KNOWN = 100


class Placed(NamedTuple):
    """Heights of lidar and SPC on one grid, and where the transform moves the lidar to.

    Attributes
    ----------
    lidar, spc : (N, N) ndarray
        Metres along the grid's Uz; NaN where unknown.
    shift : (2,) ndarray
        Displacement of the lidar surface by the transform along x and y, cells; NaN where none is
        known.
    reach : int
        Largest displacement that is searched, cells.
    noise : float
        Standard deviation that is stated of the difference of the two, metres; 0 if none is.
    """

    lidar: FloatArray
    spc: FloatArray
    shift: FloatArray
    reach: int
    noise: float = 0.0


@dataclass(frozen=True, eq=False)
class CommonRelief:
    """How clearly mapolas and SPC surface show the same relief.

    Attributes
    ----------
    clearness : (N,) ndarray
        By how many standard deviations of unrelated ground the correlation exceeds its mean; NaN
        where there is no relief above the noise to compare.
    apart : (N,) ndarray
        Distance of the place of the best correlation from where the transform puts the mapola,
        cells; NaN where one of them is not known.
    chance : float
        Share of unrelated pairs that are as clear as is asked for, at a place that is as near.
    """

    clearness: FloatArray
    apart: FloatArray
    chance: float

    @property
    def shown(self) -> BoolArray:
        """Mask (N,) of the mapolas whose relief is that of SPC at the place of the transform."""
        near = np.isnan(self.apart) | (self.apart <= _BESIDE)
        return (self.clearness > SHOWN) & near

    @property
    def compared(self) -> int:
        """Number of mapolas with relief to compare."""
        return int(np.isfinite(self.clearness).sum())

    @property
    def share(self) -> float:
        """Share of the compared mapolas that show the relief of SPC; NaN if none is compared."""
        return float(np.sum(self.shown)) / self.compared if self.compared else float("nan")


def common_relief(surfaces: Sequence[Placed]) -> CommonRelief:
    """Compare the relief of lidar and SPC with that of unrelated ground.

    Parameters
    ----------
    surfaces : sequence of Placed
        Some two dozen tell; the work grows with the square of their number.

    Returns
    -------
    CommonRelief
    """
    parted = [(_relief(one.lidar), _relief(one.spc)) for one in surfaces]
    clearness, apart, by_chance = [], [], []
    for number, (one, (lidar, spc)) in enumerate(zip(surfaces, parted, strict=True)):
        pairs = [(lidar, spc)]
        pairs += [(lidar, other) for k, (_, other) in enumerate(parted) if k != number]
        pairs += [(elsewhere, spc) for elsewhere in _elsewhere(lidar)]
        found = _clearest([_best(*pair, one.reach) for pair in pairs])
        away = np.hypot(*(found.place - one.shift).T)
        own = found.clearness[0]
        clearness.append(own if own > SHOWN or lidar.height > one.noise else np.nan)
        apart.append(away[0])
        by_chance.append((found.clearness[1:] > SHOWN) & ~(away[1:] > _BESIDE))
    chance = float(np.mean(np.concatenate(by_chance))) if by_chance else 0.0
    return CommonRelief(np.array(clearness), np.array(apart), chance)


class _Relief(NamedTuple):
    """Whole and fine relief (2, N, N), metres, and where (N, N) it is known."""

    bands: FloatArray
    known: BoolArray

    @property
    def height(self) -> float:
        """Standard deviation of the whole relief, metres; 0 where nothing is known."""
        return float(np.std(self.bands[0][self.known])) if self.known.any() else 0.0


class _Best(NamedTuple):
    """Fisher's z (2,) of the best correlation in each band, and its place (2, 2), x, y, cells."""

    fisher: FloatArray
    place: FloatArray


class _Clearest(NamedTuple):
    """Clearness (M,) of M pairs, each in the band where it is greater, and its place (M, 2)."""

    clearness: FloatArray
    place: FloatArray


def _relief(height: FloatArray) -> _Relief:
    """Part heights (N, N), metres, less their paraboloid, by wavelength.

    The roundness of the body is no relief: every place has it.
    """
    known = np.isfinite(height)
    if np.count_nonzero(known) < _LEAST_KNOWN:
        return _Relief(np.zeros((2, *height.shape)), np.zeros(height.shape, dtype=bool))
    whole = bridged(height - trend_of(height))
    fine = whole - ndimage.gaussian_filter(whole, _FINE)
    bands = np.stack([whole, fine])
    bands -= np.mean(bands[:, known], axis=1)[:, None, None]
    # What rounding leaves of a paraboloid is no relief.
    if np.std(bands[0][known]) < _ROUNDING * np.max(np.abs(height[known])):
        bands[:] = 0.0
    return _Relief(np.where(known, bands, 0.0), known)


def _elsewhere(relief: _Relief) -> list[_Relief]:
    """Return the relief turned by quarters, mirrored and shifted by half its grid, 31 ways."""
    rows, columns = (size // 2 for size in relief.known.shape)
    made = []
    for mirrored in (False, True):
        for quarters in range(4):
            for down, right in ((0, 0), (rows, 0), (0, columns), (rows, columns)):
                if mirrored or quarters or down or right:
                    made.append(_turned(relief, quarters, mirrored, (down, right)))
    return made


def _turned(relief: _Relief, quarters: int, mirrored: bool, moved: tuple[int, int]) -> _Relief:
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
    start = [(have - want) // 2 for have, want in zip(relief.known.shape, size, strict=True)]
    rows, columns = (slice(at, at + want) for at, want in zip(start, size, strict=True))
    return _Relief(
        np.ascontiguousarray(relief.bands[:, rows, columns]),
        np.ascontiguousarray(relief.known[rows, columns]),
    )


def _clearest(found: Sequence[_Best]) -> _Clearest:
    """By how many standard deviations of unrelated pairs each pair correlates; the first is own."""
    fisher = np.array([one.fisher for one in found])
    # Where a surface has no texture all correlations are unknown: its clearness stays so.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        spread = np.nanstd(fisher[1:], axis=0)
        scaled = (fisher - np.nanmean(fisher[1:], axis=0)) / np.where(spread > 0, spread, np.nan)
    band = np.argmax(np.where(np.isnan(scaled), -np.inf, scaled), axis=1)
    place = np.array([one.place[k] for one, k in zip(found, band, strict=True)])
    return _Clearest(scaled[np.arange(len(band)), band], place)
