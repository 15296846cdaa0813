"""Overlaps of maplets, as the files of landmarks list them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from spcola.control.landmark import MapOverlap
from spcola.grids import MapletGrid

# Neighbours of a maplet: centres within its square, or not far outside, that face its way.
_NEAR, _FACING = 1.5, 0.5


def overlaps_of(grids: Mapping[str, MapletGrid]) -> list[tuple[MapOverlap, ...]]:
    """Return, for each maplet, those whose centre lies within its square or not far outside.

    Parameters
    ----------
    grids : mapping of str to MapletGrid
        All maplets by name; overlaps are in their order.
    """
    names = list(grids)
    centers = np.array([grid.center for grid in grids.values()]).reshape(-1, 3)
    normals = np.array([grid.uz for grid in grids.values()]).reshape(-1, 3)
    tree = cKDTree(centers)
    found = []
    for number, grid in enumerate(grids.values()):
        reach = _NEAR * grid.half_size
        # A neighbour that faces this way at all is no higher than its distance.
        near = np.array(tree.query_ball_point(centers[number], 2.0 * reach * grid.gsd))
        near = np.sort(near[near != number])
        x, y, _ = grid.project(centers[near])
        facing = normals[near] @ grid.uz > _FACING
        taken = near[facing & (np.maximum(np.abs(x), np.abs(y)) < reach)]
        found.append(tuple(map_overlap(names[k], grid, grids[names[k]]) for k in taken))
    return found


def map_overlap(name: str, grid: MapletGrid, neighbour: MapletGrid) -> MapOverlap:
    """Return the overlap of a maplet with a neighbour, with two decimals.

    Parameters
    ----------
    name : str
        Of the neighbour.
    grid, neighbour : MapletGrid
        Of the maplet, and of the neighbour.
    """
    x, y, height = grid.project(neighbour.center)
    numbers = np.round([x, y, height / grid.gsd], 2)
    return MapOverlap(name, *numbers.tolist())
