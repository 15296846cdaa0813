"""The base of a body: one closed mesh without duplicate vertices."""

from __future__ import annotations

import numpy as np

from spcola.arrays import IntArray
from spcola.errors import InvalidValueError
from spcola.shape import Mesh


def closed_base(mesh: Mesh) -> Mesh:
    """Return a mesh with vertices of equal place joined, and without unused ones.

    Files of ICQ shapes list the vertices along the edges of their faces twice.

    Raises
    ------
    InvalidValueError
        If it is not closed: an edge does not belong to two facets that face the same side; or if
        its facets face inward.
    """
    used = np.unique(mesh.facets)
    vertices, number = np.unique(mesh.vertices[used], axis=0, return_inverse=True)
    renumbered = np.full(len(mesh.vertices), -1)
    renumbered[used] = number.ravel()
    facets = renumbered[mesh.facets]
    without_area = (facets == np.roll(facets, 1, axis=1)).any(axis=1)
    joined = Mesh(vertices, facets[~without_area], mesh.name, mesh.remark)
    if not _is_closed(joined.facets, len(vertices)):
        raise InvalidValueError("is not closed", mesh.name, "give a shape without holes")
    if joined.volume <= 0:
        raise InvalidValueError("has its facets inward", mesh.name, "exchange two of their corners")
    return joined


def _is_closed(facets: IntArray, count: int) -> bool:
    """Return whether each edge belongs to two facets, and runs in opposite directions there."""
    first, second = facets.ravel(), np.roll(facets, -1, axis=1).ravel()
    there, back = np.sort(first * count + second), np.sort(second * count + first)
    return bool((np.diff(there) > 0).all() and np.array_equal(there, back))
