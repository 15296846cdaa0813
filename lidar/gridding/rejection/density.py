"""Whether a scan samples its ground densely, so that a return without neighbours is suspicious.

A raster leaves no shot alone but at its rim: a lone return in its gaps is an outlier. A track, or
single shots, consist of lone returns. The number of returns in a cell does not separate the two,
but the cells around do. Each scan is judged by itself, since a track may cross a raster.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve
from scipy.spatial import KDTree

from lidar.gridding.cells.cells import CellReturns
from spcola.arrays import AnyArray, BoolArray, IntArray

# Share of its testable returns that must agree with the ground for a sparse scan to be trusted.
_AGREEING = 0.9
# A shot further than so many times its scan's usual spacing from the next is unusual.
_UNUSUAL = 3.0


def is_dense(count: AnyArray, few: int, radius: int) -> bool:
    """Return whether returns sample their ground densely, unlike a track or single shots.

    Parameters
    ----------
    count : (R, C) ndarray of int
        Returns in each cell.
    few : int
        Returns are dense if the median cell has more than these …
    radius : int
        … or if returns fill a larger share of the (2 radius + 1)² − 1 cells around the median cell
        than a straight track can cross, which is 4 radius. Cells beyond the grid do not count.
    """
    there = count > 0
    if not there.any():
        return False
    if float(np.median(count[there])) > few:
        return True
    share = filled_around(count, radius) / filled_around(np.ones_like(count), radius)
    return float(np.median(share[there])) > 4 * radius / ((2 * radius + 1) ** 2 - 1)


def filled_around(count: AnyArray, radius: int) -> IntArray:
    """Return how many of the (2 radius + 1)² − 1 cells around each cell (R, C) have returns."""
    there = (count > 0).astype(np.int64)
    across = np.ones((1, 2 * radius + 1), dtype=np.int64)
    along = convolve(there, across.T, mode="constant")
    around: IntArray = convolve(along, across, mode="constant") - there
    return around


def needs_support(
    cells: CellReturns,
    scan: IntArray,
    tests: tuple[BoolArray, BoolArray],
    few: int,
    window: tuple[int, int],
) -> BoolArray:
    """Return which returns (K,) are suspicious if no neighbour supports them.

    - All returns of a dense scan.
    - Where all scans together are dense: of a sparse scan those further from its other returns
      than is usual for it, and all if too few of its returns agree with the ground (it may be what
      outliers of a raster beyond the grid have left on it).

    Parameters
    ----------
    cells : CellReturns
    scan : (K,) ndarray of int
        Number of each return's scan.
    tests : two (K,) ndarrays of bool
        Whether the neighbourhood of a return is large enough to judge it, and whether it agrees.
    few : int
        See :func:`is_dense`.
    window : (int, int)
        Half-width of a neighbourhood, cells, and least number of returns that show whether a sparse
        scan agrees.
    """
    needed = np.zeros(len(scan), dtype=np.bool_)
    together = is_dense(cells.count, few, window[0])
    for number in np.flatnonzero(np.bincount(scan)):
        own = np.flatnonzero(scan == number)
        cell = cells.cell[own]
        count = np.bincount(cell, minlength=len(cells.start) - 1).reshape(cells.shape)
        if is_dense(count, few, window[0]):
            needed[own] = True
        elif together:
            tested, agreeing = (np.count_nonzero(mask[own]) for mask in tests)
            trusted = tested >= window[1] and agreeing >= _AGREEING * tested
            needed[own] = _unusually_far(cell, cells.shape[1]) if trusted else True
    return needed


def _unusually_far(cell: IntArray, columns: int) -> BoolArray:
    """Return which of the cells (N,) of returns are unusually far from the next cell with one."""
    chosen, number = np.unique(cell, return_inverse=True)
    if len(chosen) < 2:
        return np.ones(len(cell), dtype=np.bool_)
    place = np.stack(np.divmod(chosen, columns), axis=1).astype(np.float64)
    distance = np.asarray(KDTree(place).query(place, k=2)[0])[:, 1]
    far: BoolArray = distance > _UNUSUAL * np.median(distance)
    return far[number]
