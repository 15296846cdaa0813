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
    vertices, normals, active = mesh.vertices, mesh.normals, mesh.facets
    settled = []
    for _ in range(_MOST_ROUNDS):
        # A facet none of whose edges is too long never changes again: nor do its neighbours'.
        marked = _too_long(vertices, active, longest)
        divided = marked.any(axis=1)
        settled.append(active[~divided])
        active, marked = active[divided], marked[divided]
        if not len(active):
            break
        edges, middles = _numbered(active, marked, len(vertices))
        place, normal = _middles(vertices[edges], normals[edges], curved=curved)
        vertices, normals = np.concatenate([vertices, place]), np.concatenate([normals, normal])
        active = _divided(active, middles)
    return SmoothMesh(vertices, normals, np.concatenate([*settled, active]))


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


def _too_long(
    vertices: FloatArray, facets: IntArray, longest: Callable[[FloatArray], FloatArray]
) -> BoolArray:
    """Return which edges (F, 3) of facets are too long: 01, 12, 20; alike from either side."""
    marked = np.empty(facets.shape, dtype=np.bool_)
    for edge in range(3):
        a, b = vertices[facets[:, edge]], vertices[facets[:, (edge + 1) % 3]]
        marked[:, edge] = np.sqrt(np.sum((b - a) ** 2, axis=1)) > longest(0.5 * (a + b))
    return marked


def _numbered(facets: IntArray, marked: BoolArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the marked edges (E, 2), each once, and the numbers (F, 3) of their middles.

    New vertices are numbered from `count`; −1 for edges that are not marked.
    """
    first, second = facets[marked], np.roll(facets, -1, axis=1)[marked]
    keys, number = np.unique(
        np.minimum(first, second) * count + np.maximum(first, second), return_inverse=True
    )
    middles = np.full(facets.shape, -1)
    middles[marked] = count + number.ravel()
    return np.stack(np.divmod(keys, count), axis=1), middles


def _middles(
    ends: FloatArray, normals: FloatArray, *, curved: bool
) -> tuple[FloatArray, FloatArray]:
    """Return places and normals (E, 3) in the middle of edges, from those of the ends (E, 2, 3)."""
    (a, b), (m, n) = ends.transpose(1, 0, 2), normals.transpose(1, 0, 2)
    place = 0.5 * (a + b)
    if curved:
        rise_a, rise_b = np.sum((b - a) * m, axis=1), np.sum((a - b) * n, axis=1)
        place = place - (rise_a[:, None] * m + rise_b[:, None] * n) / 8.0
    return place, unit_rows(m + n)


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
