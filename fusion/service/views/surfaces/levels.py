"""Overview levels of a layer: cells of 2 × 2, 4 × 4, … grid points."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from spcola.arrays import BoolArray, FloatArray

TILE = 256
"""Cells along a side of a tile."""


class Rule(StrEnum):
    """How the values of the grid points in a cell become its value."""

    MEAN = "mean of the known values"
    SIGMA = (
        "mean of the sigmas of the known heights: an upper bound of the sigma of their mean, and "
        "equal to it if their errors are common; NaN if one is unknown"
    )
    SUM = "sum"
    NEAREST = "the grid point nearest to the middle of the cell (of equals the lower right one)"


def levels_of(size: int) -> tuple[int, ...]:
    """Return 1, 2, 4, … up to the first level of which one tile holds the whole grid.

    Parameters
    ----------
    size : int
        Grid points along a side.
    """
    found = [1]
    while size > TILE * found[-1]:
        found.append(2 * found[-1])
    return tuple(found)


def cells_of(size: int, level: int) -> int:
    """Return the number of cells along a side; the last one may have fewer grid points."""
    return -(-size // level)


def sums_of(values: FloatArray, known: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the sums over 2 × 2 known values, and their numbers; the two are a band of a layer.

    Parameters
    ----------
    values : (R, C) ndarray
        R even, except in the last band.
    known : (R, C) ndarray
        Which values count. One of them that is NaN makes the sum NaN.
    """
    return _halved(np.where(known, values, 0.0)), _halved(known.astype(np.float32))


def overviews(
    bands: Iterable[tuple[FloatArray, FloatArray]], levels: Iterable[int], rule: Rule
) -> dict[int, FloatArray]:
    """Reduce a layer to its levels above 1.

    Parameters
    ----------
    bands : iterable of (sums, numbers)
        From :func:`sums_of`, of all rows in their order.
    levels : iterable of int
        From 2 on, each twice the one before.
    rule : Rule
        ``MEAN``, ``SIGMA`` or ``SUM``.

    Returns
    -------
    dict of int to (R, C) float32 ndarray
        NaN where nothing is known.
    """
    sums, numbers = zip(*bands, strict=True)
    total, number = np.concatenate(sums), np.concatenate(numbers)
    found = {}
    for level in levels:
        if level > 2:
            total, number = _halved(total), _halved(number)
        divisor = np.where(number > 0, 1.0 if rule is Rule.SUM else number, np.nan)
        found[level] = (total / divisor).astype(np.float32)
    return found


def nearest(values: FloatArray, level: int) -> FloatArray:
    """Return the values (R, C) at the grid points nearest to the middles of the cells."""
    size = len(values)
    middles = np.minimum(np.arange(cells_of(size, level)) * level + level // 2, size - 1)
    return values[np.ix_(middles, middles)].astype(np.float32)


def _halved(values: FloatArray) -> FloatArray:
    """Return the sums over 2 × 2 values; over fewer at the far sides of an odd number."""
    rows, columns = values.shape
    if rows % 2 or columns % 2:
        values = np.pad(values, ((0, rows % 2), (0, columns % 2)))
    pairs = values[0::2] + values[1::2]
    summed: FloatArray = pairs[:, 0::2] + pairs[:, 1::2]
    return summed
