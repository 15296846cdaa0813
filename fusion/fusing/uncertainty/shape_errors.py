"""Errors of the shape model on ground without SPC heights, estimated from the lidar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.fusing.uncertainty.variogram import correlated_cells, mean_square, walk_sigma
from spcola.arrays import FloatArray

# Fewer differences than this do not determine a spread.
_ENOUGH = 200
# Largest lag of the variogram, cells.
_REACH = 8


@dataclass(frozen=True)
class ShapeErrors:
    """Uncertainty of the shape between neighbouring points, and of its heights.

    Parameters
    ----------
    step_sigma_m : float
        Standard deviation of the error of a height step between neighbours, metres, as if steps
        erred independently.
    height_sigma_m : float
        Root mean square error of a height, metres.
    correlated_cells : float
        Number of neighbouring points over which errors are correlated.
    """

    step_sigma_m: float
    height_sigma_m: float
    correlated_cells: float


def estimate_shape_errors(departures: Sequence[FloatArray]) -> ShapeErrors | None:
    """Estimate the errors of the shape from lidar minus shape heights.

    Boulders missing in the shape are errors, so mean squares are used rather than medians. The
    lidar's noise is not subtracted, which is conservative.

    Parameters
    ----------
    departures : sequence of (2q+1, 2q+1) ndarrays
        Lidar minus shape, metres, on grids of one GSD; NaN where it is not used.

    Returns
    -------
    ShapeErrors or None
        None if at any lag up to 8 cells fewer than 200 differences are known.
    """
    squares, counts = mean_square(departures, _REACH)
    if min(counts) < _ENOUGH:
        return None
    known = np.concatenate([layer[np.isfinite(layer)] for layer in departures])
    height = float(np.sqrt(np.mean(known**2)))
    return ShapeErrors(walk_sigma(squares), height, correlated_cells(squares, height))
