"""Sources of the points of a bigmap, from the fused maplets that it was made of."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fusion.fusing.maplets.maplet import FusedMaplet, Source
from spcola.arrays import AnyArray
from spcola.grids import Maplet, MapletGrid

_IMAGE, _LIDAR = 1, 2
_BITS = np.array([0, _IMAGE, _LIDAR, _IMAGE | _LIDAR, 0], dtype=np.uint8)
"""Bits for images and lidar of each :class:`~fusion.fusing.maplets.Source`."""


def fused_bigmap(bigmap: Maplet, maplets: Iterable[FusedMaplet]) -> FusedMaplet:
    """Give each point of `bigmap` its source and its count of lidar returns.

    Each fused maplet is sampled at its grid point nearest to the bigmap's, at most half a cell off
    along either axis. The source of a point includes images if it does in one maplet, and lidar if
    it does in one; it is "filled" otherwise. Overlapping maplets count the same returns, so the
    count is the largest of the maplets' counts, in their own cells.

    Parameters
    ----------
    bigmap : Maplet
        Its heights, sigma and albedo are kept.
    maplets : iterable of FusedMaplet
        In the same frame; those that lie elsewhere are skipped.
    """
    count = np.zeros(bigmap.grid.shape, dtype=np.int32)
    bits = np.zeros(bigmap.grid.shape, dtype=np.uint8)
    points = bigmap.points()[bigmap.valid]
    for maplet in maplets:
        if float(maplet.grid.uz @ bigmap.grid.uz) <= 0.0:
            continue
        inside, row, column = _nearest(maplet.grid, points)
        here = np.zeros(bigmap.grid.shape, dtype=bool)
        here[bigmap.valid] = inside
        count[here] = np.maximum(count[here], maplet.count[row, column])
        bits[here] |= _BITS[maplet.source[row, column]]
    source = np.where(bits == 0, np.uint8(Source.FILLED), bits)
    return FusedMaplet(
        bigmap.name,
        bigmap.grid,
        bigmap.height,
        bigmap.albedo,
        bigmap.sigma,
        bigmap.center_sigma,
        count,
        np.where(bigmap.valid, source, np.uint8(Source.NONE)),
    )


def _nearest(grid: MapletGrid, points: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Mask (N,) of the points over `grid`; row and column of the nearest node of those.

    A point on the far side of the body projects into the grid too: it lies deeper below the
    plane than the grid is wide.
    """
    x, y, height = grid.project(points)
    q = grid.half_size
    inside = (np.abs(x) <= q + 0.5) & (np.abs(y) <= q + 0.5) & (np.abs(height) <= 2 * grid.radius)
    row = np.clip(np.rint(y[inside]).astype(np.int64) + q, 0, 2 * q)
    column = np.clip(np.rint(x[inside]).astype(np.int64) + q, 0, 2 * q)
    return inside, row, column
