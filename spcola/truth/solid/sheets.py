"""All heights of a mesh over a grid, where several sheets lie one above the other."""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray
from spcola.grids import MapletGrid
from spcola.shape import RayCaster

_MOST_HITS = 16
# Step past a hit, over the radius of the mesh.
_PAST = 1e-9
# The second nearest sheet is at least this many times as far away as the nearest.
_CLEAR = 2.0


def sheets_of(caster: RayCaster, grid: MapletGrid) -> FloatArray:
    """Return all heights (K, 2q+1, 2q+1) of a mesh whose facets face Uz, the highest first.

    Parameters
    ----------
    caster : RayCaster
    grid : MapletGrid
        Heights within two of its radii of its plane are looked for.

    Returns
    -------
    (K, 2q+1, 2q+1) ndarray
        Metres; K is the largest number of them over a node (1 at least), NaN after the last.
    """
    reach = 2.0 * grid.radius
    nodes = grid.points(np.zeros(grid.shape)).reshape(-1, 3)
    found = np.full((_MOST_HITS, len(nodes)), np.nan)
    count = np.zeros(len(nodes), dtype=np.int64)
    height = np.full(len(nodes), reach)
    waiting = np.arange(len(nodes))
    for _ in range(_MOST_HITS):
        starts = nodes[waiting] + height[waiting, None] * grid.uz
        hits = caster.cast(starts, np.broadcast_to(-grid.uz, starts.shape))
        at = height[waiting] - hits.distance
        there = hits.hit & (at >= -reach)
        up = there & (hits.normals @ grid.uz > 0)
        found[count[waiting[up]], waiting[up]] = at[up]
        count[waiting[up]] += 1
        height[waiting] = at - _PAST * caster.radius
        waiting = waiting[there]
        if not waiting.size:
            break
    return found[: max(1, int(count.max(initial=0)))].reshape(-1, *grid.shape)


def single_sheet(sheets: FloatArray) -> FloatArray:
    """Return the heights (R, C) where there is one; NaN where there are several or none.

    Parameters
    ----------
    sheets : (K, R, C) ndarray
        From :func:`sheets_of`.
    """
    single: FloatArray = np.where(np.isfinite(sheets).sum(axis=0) == 1, sheets[0], np.nan)
    return single


def nearest_sheet(sheets: FloatArray, model: FloatArray) -> FloatArray:
    """Return the heights (R, C) nearest to a model's (R, C), metres.

    Where there is one it is returned, whatever the model. NaN where the second nearest is less
    than twice as far from the model as the nearest, or the model has no height.

    Parameters
    ----------
    sheets : (K, R, C) ndarray
        From :func:`sheets_of`.
    model : (R, C) ndarray
    """
    if len(sheets) == 1:
        return single_sheet(sheets)
    away = np.where(np.isfinite(sheets), np.abs(sheets - model), np.inf)
    order = np.argsort(away, axis=0)
    nearest = np.take_along_axis(sheets, order[:1], axis=0)[0]
    first, second = np.take_along_axis(away, order[:2], axis=0)
    several = np.where(second > _CLEAR * first, nearest, np.nan)
    return np.where(np.isfinite(sheets).sum(axis=0) == 1, sheets[0], several)
