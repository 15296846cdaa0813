"""The base of a body: one closed mesh without duplicate vertices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spcola.arrays import IntArray
from spcola.errors import InvalidValueError
from spcola.shape import Mesh, RayCaster


def closed_base(mesh: Mesh) -> Mesh:
    """Return a mesh with vertices of equal place joined, and without unused ones.

    Files of ICQ shapes list the vertices along the edges of their faces twice.

    Raises
    ------
    InvalidValueError
        If it is not closed: an edge does not belong to two facets that face the same side; if it
        has several pieces, if its facets face inward, or if the origin is outside.
    """
    used = np.unique(mesh.facets)
    vertices, number = np.unique(mesh.vertices[used], axis=0, return_inverse=True)
    renumbered = np.full(len(mesh.vertices), -1)
    renumbered[used] = number.ravel()
    facets = renumbered[mesh.facets]
    without_area = (facets == np.roll(facets, 1, axis=1)).any(axis=1)
    joined = Mesh(vertices, facets[~without_area], mesh.name, mesh.remark)
    _check_edges(joined.facets, len(vertices), mesh.name)
    pieces = connected_components(_links(joined.facets, len(vertices)), directed=False)[0]
    if pieces > 1:
        raise InvalidValueError(f"has {pieces} separate pieces", mesh.name, "give one body")
    if joined.volume <= 0:
        raise InvalidValueError("has its facets inward", mesh.name, "exchange two of their corners")
    if not RayCaster(joined).closest(np.zeros((1, 3))).distance[0] < 0.0:
        raise InvalidValueError(
            "does not have the origin inside", mesh.name, "move it to its centre"
        )  # fmt: skip
    return joined


def _links(facets: IntArray, count: int) -> coo_array:
    """Return how often (V, V) an edge runs from one vertex to another."""
    first, second = facets.ravel(), np.roll(facets, -1, axis=1).ravel()
    return coo_array((np.ones(len(first), dtype=np.int64), (first, second)), shape=(count, count))


def _check_edges(facets: IntArray, count: int, name: str) -> None:
    """Refuse facets whose edges do not belong to two of them, in opposite directions."""
    there = _links(facets, count).tocsr()
    sides = there + there.T
    holes, crowded = int(np.sum(sides.data == 1)) // 2, int(np.sum(sides.data > 2)) // 2
    if holes:
        raise InvalidValueError(
            f"is not closed: {holes} edges belong to one facet", name, "give a shape without holes"
        )
    if crowded:
        raise InvalidValueError(
            f"has {crowded} edges of more than two facets", name, "remove the facets in excess"
        )
    if twice := int(np.sum(there.data > 1)):
        raise InvalidValueError(
            f"has facets that face the other way than their neighbours, on {twice} edges", name,
            "exchange two corners of those",
        )  # fmt: skip
