"""Lone lidar heights that contradict the SPC surface: outliers, or boulders that SPC lacks.

The weights of SPC's steps depend on the ground that the lidar shows: steps across the flank of a
boulder count less. An outlier in a gap of the lidar would thus release the surface around it, and
no robust loss could act, since the surface follows without resistance. So such heights have to be
found before the weights.
"""

from __future__ import annotations

import numpy as np

from fusion.fusing.constraints import Constraints
from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.grids import Maplet
from spcola.math.robust import mad

# A height further than so many joint standard deviations from the SPC surface contradicts it.
_SIGMAS = 6.0
# Heights of more returns are not lone: the gridding has compared these with each other.
_FEW = 2
# With fewer common points it is not known which of the two is wrong.
_LEAST = 3
# A neighbouring height on the same side, by this share of the difference at least, is support.
_SHARE = 0.5
# Further from SPC than so many GSD one neighbour is not enough: two outliers may be neighbours,
# and nothing so high is two cells wide.
_HIGH = 10.0
_MANY = 3


def contradicted(lidar: Constraints, spc: Maplet, sigma: FloatArray) -> BoolArray:
    """Return which lidar heights (R, C) contradict the SPC surface without support.

    Differences are measured from the median difference, so that a maplet out of place contradicts
    nothing, and against their own robust scatter where that is larger. One of the eight lidar
    heights around that differs from SPC in the same sense supports a height; three are needed where
    it is further away than a boulder is high.

    Parameters
    ----------
    lidar : Constraints
    spc : Maplet
        On the same grid.
    sigma : (R, C) ndarray
        Of the SPC heights relative to the lidar, metres.
    """
    difference = lidar.height - spc.height
    known = np.isfinite(difference)
    if np.count_nonzero(known) < _LEAST:
        return np.zeros(known.shape, dtype=np.bool_)
    away = np.where(known, difference - np.median(difference[known]), np.nan)
    joint = np.maximum(np.hypot(lidar.sigma, sigma), float(mad(difference)))
    lone = known & (np.abs(away) > _SIGMAS * joint) & (np.asarray(lidar.count) <= _FEW)
    least = np.where(np.abs(away) > _HIGH * spc.grid.gsd, _MANY, 1)
    return lone & (_support(away, lone) < least)


def _support(away: FloatArray, asked: BoolArray) -> IntArray:
    """Return how many neighbours of the points `asked` are `away` in the same sense."""
    support = np.zeros(away.shape, dtype=np.int64)
    padded = np.pad(away, 1, constant_values=np.nan)
    for row, column in np.argwhere(asked):
        around = padded[row : row + 3, column : column + 3] * np.sign(away[row, column])
        # The point itself is among the nine.
        alike = around >= _SHARE * abs(away[row, column])
        support[row, column] = np.count_nonzero(alike) - 1
    return support
