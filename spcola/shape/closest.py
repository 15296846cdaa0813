"""The point of a triangle mesh that is closest to a point, at double accuracy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.compilation import compiled


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Points of a mesh that are closest to N points.

    Attributes
    ----------
    distance : (N,) ndarray
        Metres; negative inside of a closed mesh.
    facet : (N,) integer ndarray
        Index of the facet.
    points : (N, 3) ndarray
        Body-fixed, metres.
    """

    distance: FloatArray
    facet: IntArray
    points: FloatArray


@compiled
def on_triangle(
    p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, out: FloatArray
) -> float:
    """Fill `out` (3,) with the point of the triangle a, b, c closest to `p`; return its distance.

    Ericson, Real-Time Collision Detection (2005), section 5.1.5: by the region of the plane in
    which the foot of the perpendicular lies.
    """
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = np.sum(ab * ap), np.sum(ac * ap)
    bp, cp = p - b, p - c
    d3, d4 = np.sum(ab * bp), np.sum(ac * bp)
    d5, d6 = np.sum(ab * cp), np.sum(ac * cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / (d1 - d3), 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    out[:] = a + v * ab + w * ac
    return np.sqrt(np.sum((p - out) ** 2))


@compiled
def closest_near(
    points: FloatArray,
    found: IntArray,
    mesh: tuple[FloatArray, IntArray],
    touching: tuple[IntArray, IntArray],
    out: tuple[FloatArray, IntArray, FloatArray],
) -> None:
    """Find the closest points on the facets `found` (N,) and those that share a vertex with them.

    The distance is negative where the point lies behind the facet that faces it best: of the
    facets that meet at the closest point, another one may be seen from behind from outside.

    Parameters
    ----------
    points : (N, 3) ndarray
    found : (N,) ndarray
        Candidates.
    mesh : tuple
        Vertices (V, 3) and facets (F, 3).
    touching : tuple
        Result of :func:`spcola.shape.rays.facets_around_vertices`.
    out : tuple
        Distance (N,), facet (N,), closest points (N, 3): filled.
    """
    vertices, facets = mesh
    starts, around = touching
    distance, facet, closest = out
    trial, normal = np.empty(3), np.empty(3)
    for i in range(len(points)):
        best, facing, sign = np.inf, -1.0, 1.0
        for corner in facets[found[i]]:
            for j in range(starts[corner], starts[corner + 1]):
                g = around[j]
                a, b, c = vertices[facets[g, 0]], vertices[facets[g, 1]], vertices[facets[g, 2]]
                away = on_triangle(points[i], a, b, c, trial)
                if away > best + 1e-9 * (1.0 + best):
                    continue
                normal[:] = np.cross(b - a, c - a)
                size = np.sqrt(np.sum(normal * normal)) * max(away, 1e-300)
                cosine = np.sum(normal * (points[i] - trial)) / max(size, 1e-300)
                if away < best - 1e-9 * (1.0 + away) or abs(cosine) > facing:
                    facing, sign = abs(cosine), -1.0 if cosine < 0.0 else 1.0
                    facet[i] = g
                    closest[i] = trial
                best = min(best, away)
        distance[i] = sign * best
