"""Clouds over one plane in another frame: mirrored, rotated by 90° or 180°, heights reversed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np

from fusion.registration.clouds.clouds import grid_over, relief_of, searched
from fusion.registration.clouds.level import CloudOptions
from fusion.registration.search import Placement
from fusion.registration.search.frame_texts import frame_change
from spcola.arrays import FloatArray
from spcola.errors import NotObservableError

# Cells along a side on which the relief is compared, about.
_CELLS = 48
# Cosine of the largest angle between the two planes at which a frame is tried.
_PARALLEL = 0.9


def flat_frame(
    moving: FloatArray, fixed: FloatArray, origin: FloatArray, options: CloudOptions
) -> str:
    """Find the exchange or reversal of axes after which a cloud shows the relief of the other.

    All 47 exchanges and reversals of axes are tried that keep the cloud's plane parallel to the
    other's, about the origin of its coordinates and about its own middle, each with a search of the
    translation. One counts if the relief then agrees as unrelated ground does not.

    Parameters
    ----------
    moving, fixed : (N, 3), (M, 3) ndarrays
        Metres.
    origin : (3,) ndarray
        Origin of the moving cloud's coordinates, metres.
    options : CloudOptions

    Returns
    -------
    str
        A clause with the moving cloud as its subject, such as "fits when mirrored in X"; empty if
        it fits in no such frame.
    """
    grid = grid_over(fixed, len(moving), options.gsd_m)
    step = max(1, grid.size // _CELLS)
    grid = grid.with_gsd(step * grid.gsd)
    moving, fixed = moving[::step], fixed[::step]
    middle = moving.mean(axis=0)
    normal = np.linalg.eigh((moving - middle).T @ (moving - middle))[1][:, 0]
    best, text = 0.0, ""
    for matrix in _exchanges():
        if abs(grid.axes[2] @ matrix @ normal) < _PARALLEL:
            continue
        for about in (origin, middle):
            placed = (moving - about) @ matrix.T + about
            try:
                at = searched(placed, fixed, grid, options)
            except NotObservableError:
                continue
            relief = relief_of(placed, fixed, grid, at)
            if relief.shown.all() and relief.z_score[0] > best:
                best = float(relief.z_score[0])
                text = frame_change(Placement(matrix, np.zeros(3), 1.0), 1.0, 0.0).text
    return text


def _exchanges() -> Iterator[FloatArray]:
    """All orthogonal matrices (3, 3) of 0 and ±1 but the identity."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if not np.array_equal(matrix, np.eye(3)):
            yield matrix
