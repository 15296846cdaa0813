"""One mesh of the surfaces of several maplets."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from spcola.errors import InvalidValueError
from spcola.grids import Maplet
from spcola.shape.mesh import Mesh


def mesh_of_maplets(maplets: Iterable[Maplet], step: float) -> Mesh:
    """Return a mesh of all maplets, each by itself: where they overlap, it has several sheets.

    Parameters
    ----------
    maplets : iterable of Maplet
        Used one after the other.
    step : float
        Metres; every so many points of a maplet are used that its facets are no finer.

    Raises
    ------
    InvalidValueError
        If no maplet has a cell with heights at all corners.
    """
    vertices, facets, count = [], [], 0
    for maplet in maplets:
        stride = min(max(1, int(step / maplet.grid.gsd)), maplet.grid.half_size)
        # From the centre outward, so that the middle is always there.
        half = maplet.grid.half_size // stride * stride
        rows = np.arange(-half, half + 1, stride) + maplet.grid.half_size
        points = maplet.points()[np.ix_(rows, rows)]
        index = np.arange(len(rows) ** 2).reshape(len(rows), -1)
        # Columns run along Ux and rows along Uy: counter-clockwise seen from Uz.
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
        halves = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
        corners = np.concatenate(halves)
        known = np.isfinite(points).all(axis=-1).ravel()
        corners = corners[known[corners].all(axis=1)]
        used, numbers = np.unique(corners, return_inverse=True)
        vertices.append(points.reshape(-1, 3)[used])
        facets.append(numbers.reshape(-1, 3) + count)
        count += len(used)
    if not count:
        raise InvalidValueError("none has heights", "maplets")
    return Mesh(np.concatenate(vertices), np.concatenate(facets), "maplets")
