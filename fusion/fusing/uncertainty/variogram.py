"""Variograms: how differences of a surface's errors grow with the distance of two points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spcola.arrays import FloatArray


def ends(values: FloatArray, lag: int, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return the values `lag` cells ahead along `axis`, and those they are compared with."""
    ahead = np.take(values, range(lag, values.shape[axis]), axis=axis)
    behind = np.take(values, range(values.shape[axis] - lag), axis=axis)
    return ahead, behind


def mean_square(layers: Sequence[FloatArray], reach: int) -> tuple[FloatArray, list[int]]:
    """Return the mean squared difference (L,) over 1 … `reach` cells, and the numbers of pairs.

    Along both axes of `layers` (R, C), NaN where unknown; 0 where there are no pairs.
    """
    squares, counts = [], []
    for lag in range(1, reach + 1):
        pairs = [np.subtract(*ends(layer, lag, axis)) for layer in layers for axis in (0, 1)]
        steps = np.concatenate([pair[np.isfinite(pair)] for pair in pairs] or [np.empty(0)])
        squares.append(float(np.mean(steps**2)) if steps.size else 0.0)
        counts.append(steps.size)
    return np.array(squares), counts


def walk_sigma(variogram: FloatArray) -> float:
    """Smallest sigma of a step, metres, for which no difference is more certain than observed.

    On a square grid whose steps err independently with σ, the difference over L cells has the
    variance σ² R(L), R being the resistance between two nodes of a grid of unit resistors: 1/2 for
    neighbours, about (ln L + 1.617) / π beyond (Cserti 2000, Am. J. Phys. 68, 896). It grows far
    less than along a line, because there are many paths between two nodes.

    Parameters
    ----------
    variogram : (L,) ndarray
        Variance of the difference over 1 … L cells, square metres.

    Returns
    -------
    float
        Metres; at least 0.1 mm.
    """
    lags = np.arange(1, len(variogram) + 1)
    resistance = np.where(lags == 1, 0.5, (np.log(lags) + 1.617) / np.pi)
    return float(np.sqrt(max(float(np.max(variogram / resistance)), 1e-8)))


def correlated_cells(variogram: FloatArray, height_sigma: float) -> float:
    """Correlation area of height errors, cells: π L², where γ(L) reaches 63 % of the sill."""
    sill = 2.0 * height_sigma**2
    reached = np.nonzero(variogram >= 0.63 * sill)[0]
    length = float(reached[0] + 1) if reached.size else float(len(variogram))
    return float(np.pi * length**2)
