"""A mesh whose edges are short enough: edges are halved until none is too long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray

_MOST_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class SmoothMesh:
    """A triangle mesh with the normals of the smooth surface that it stands for.

    Attributes
    ----------
    vertices : (V, 3) ndarray
        Metres.
    normals : (V, 3) ndarray
        Unit normals at the vertices, outward.
    facets : (F, 3) integer ndarray
        Counter-clockwise seen from outside.
    """

    vertices: FloatArray
    normals: FloatArray
    facets: IntArray


def refined(
    mesh: SmoothMesh, longest: Callable[[FloatArray], FloatArray], *, curved: bool
) -> SmoothMesh:
    """Halve edges until none is longer than `longest`; the mesh stays free of gaps.

    Parameters
    ----------
    mesh : SmoothMesh
        Its vertices are unchanged.
    longest : callable
        Returns the greatest length of edges (N,), metres, by their middles (N, 3).
    curved : bool
        Whether new vertices lie on the cubic that meets the normals of both ends at right angles
        (the edges of PN triangles: Vlachos et al. 2001), or on the edge.
    """
    for _ in range(_MOST_ROUNDS):
        edges, of_facet = _edges(mesh.facets, len(mesh.vertices))
        a, b = (mesh.vertices[edges[:, end]] for end in (0, 1))
        middle = 0.5 * (a + b)
        marked = np.sqrt(np.sum((b - a) ** 2, axis=1)) > longest(middle)
        if not marked.any():
            break
        mesh = _halved(mesh, edges[marked], _numbers(marked, len(mesh.vertices))[of_facet], curved)
    return mesh


def vertex_normals(vertices: FloatArray, facets: IntArray) -> FloatArray:
    """Return unit normals (V, 3) at the vertices: means of the facets', weighted by area."""
    a, b, c = (vertices[facets[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    corner = facets.ravel()
    parts = [
        np.bincount(corner, np.repeat(across[:, axis], 3), minlength=len(vertices))
        for axis in range(3)
    ]
    return unit_rows(np.stack(parts, axis=1))


def unit_rows(vectors: FloatArray) -> FloatArray:
    """Return `vectors` (N, 3) scaled to length 1."""
    scaled: FloatArray = vectors / np.sqrt(np.sum(vectors**2, axis=1))[:, None]
    return scaled


def _edges(facets: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the edges (E, 2), each once, and those of every facet (F, 3): 01, 12, 20."""
    ends = np.stack([facets, np.roll(facets, -1, axis=1)], axis=2)
    key = ends.min(axis=2) * count + ends.max(axis=2)
    unique, of_facet = np.unique(key.ravel(), return_inverse=True)
    return np.stack(np.divmod(unique, count), axis=1), of_facet.reshape(-1, 3)


def _numbers(marked: BoolArray, first: int) -> IntArray:
    """Return the number (E,) of the vertex in the middle of each edge; −1 for none."""
    return np.where(marked, first - 1 + np.cumsum(marked), -1)


def _halved(mesh: SmoothMesh, edges: IntArray, middles: IntArray, curved: bool) -> SmoothMesh:
    """Return the mesh with a vertex in the middle of the `edges` (E, 2).

    `middles` (F, 3) are the numbers of these vertices on the edges of every facet; −1 for none.
    """
    (a, b), (m, n) = (
        [values[edges[:, end]] for end in (0, 1)] for values in (mesh.vertices, mesh.normals)
    )
    place = 0.5 * (a + b)
    if curved:
        ahead = b - a
        rise_a, rise_b = np.sum(ahead * m, axis=1), -np.sum(ahead * n, axis=1)
        place = place - (rise_a[:, None] * m + rise_b[:, None] * n) / 8.0
    return SmoothMesh(
        np.concatenate([mesh.vertices, place]),
        np.concatenate([mesh.normals, unit_rows(m + n)]),
        _divided(mesh.facets, middles),
    )


def _divided(facets: IntArray, middles: IntArray) -> IntArray:
    """Return the facets divided at the middles (F, 3) of their edges: into one to four."""
    count = np.sum(middles >= 0, axis=1)
    parts = [facets[count == 0]]
    three, m = facets[count == 3], middles[count == 3]
    parts += [
        np.stack([three[:, k], m[:, k], m[:, k - 1]], axis=1) for k in range(3)
    ] + [m]  # fmt: skip
    for edge in range(3):
        # Turned so that the single divided edge, or the single whole one, is the first.
        v, m = np.roll(facets, -edge, axis=1), np.roll(middles, -edge, axis=1)
        one = (count == 1) & (m[:, 0] >= 0)
        parts.append(np.stack([v[one, 0], m[one, 0], v[one, 2]], axis=1))
        parts.append(np.stack([m[one, 0], v[one, 1], v[one, 2]], axis=1))
        two = (count == 2) & (m[:, 0] < 0)
        parts.append(np.stack([m[two, 1], v[two, 2], m[two, 2]], axis=1))
        parts.append(np.stack([v[two, 0], v[two, 1], m[two, 1]], axis=1))
        parts.append(np.stack([v[two, 0], m[two, 1], m[two, 2]], axis=1))
    return np.concatenate(parts)
