"""Ray casting on a triangle mesh, at double accuracy.

Embree (through Open3D) finds the triangle in single precision; the hit is computed again in
double precision on that triangle, or on one of its neighbours where the ray passes too close to an
edge for single precision. One limit of the single-precision tree remains: a ray that grazes a
silhouette within about 1e-6 of the body's radius may hit or miss it. A hit lies on its ray and on
its facet in either case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spcola.arrays import BoolArray, FloatArray, IntArray, check_shape, read_only
from spcola.compilation import compiled
from spcola.errors import InvalidValueError
from spcola.shape.closest import ClosestPoints, closest_near
from spcola.shape.mesh import Mesh

CHUNK = 1 << 20
"""Rays handed to Embree at a time: bounds the memory of its single-precision copies."""

SLACK = 2e-6
"""Distance from an edge, over the radius of the mesh, below which neighbours are tested: sixteen
single-precision roundings of a coordinate."""

GRAIN = 1e-13
"""Distance outside an edge, over the radius of the mesh, that still counts as on the facet: the
rounding of double precision, without which a ray through a vertex could slip between facets."""

MAX_STEPS = 8
"""Most restarts of a ray behind a facet that it misses in double precision."""


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of N rays with a mesh.

    Parameters
    ----------
    distance : (N,) ndarray
        Metres from the ray's origin; NaN where it meets nothing.
    facet : (N,) integer ndarray
        Index of the facet; −1 where it meets nothing.
    points : (N, 3) ndarray
        Body-fixed positions, metres; NaN where it meets nothing.
    normals : (N, 3) ndarray
        Outward unit normals of the facets; NaN where it meets nothing.
    """

    distance: FloatArray
    facet: IntArray
    points: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.distance)

    @property
    def hit(self) -> BoolArray:
        """Mask (N,) of rays that meet the mesh."""
        return self.facet >= 0


class RayCaster:
    """Casts rays at a mesh.

    Parameters
    ----------
    mesh : Mesh
        Any triangle mesh; it need not be closed.

    Raises
    ------
    InvalidValueError
        If the mesh has no facet.

    Notes
    -----
    Safe to share between threads. Building imports Open3D, which takes most of a second.
    """

    def __init__(self, mesh: Mesh) -> None:
        if len(mesh.facets) == 0:
            raise InvalidValueError("has no facet to cast rays at", mesh.name)
        self.mesh = mesh
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        self.center: FloatArray = (low + high) / 2.0
        reach = np.linalg.norm(mesh.vertices - self.center, axis=1).max()
        self.radius = float(reach)
        self._vertices = np.ascontiguousarray(mesh.vertices - self.center)
        self._facets = read_only(np.ascontiguousarray(mesh.facets))
        self._starts, self._around = facets_around_vertices(self._facets, len(self._vertices))
        self._scene = _embree_scene(self._vertices, self._facets)

    def __reduce__(self) -> tuple[type[RayCaster], tuple[Mesh]]:
        return (RayCaster, (self.mesh,))

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """Return where rays first meet the mesh, from either side of a facet.

        Parameters
        ----------
        origins : (N, 3) or (3,) array_like
            Body-fixed, metres; one origin may serve all rays. It may lie far away.
        directions : (N, 3) array_like
            Any length but zero; a ray that is not finite meets nothing.
        """
        along = np.asarray(directions, dtype=np.float64)
        check_shape(along, (None, 3), "directions")
        starts = np.broadcast_to(np.asarray(origins, dtype=np.float64), along.shape)
        parts = [
            self._cast_chunk(starts[i : i + CHUNK], along[i : i + CHUNK])
            for i in range(0, max(len(along), 1), CHUNK)
        ]
        distance, facet, points = (np.concatenate(layer) for layer in zip(*parts, strict=True))
        normals = np.where((facet >= 0)[:, None], self.mesh.normals[facet], np.nan)
        return Hits(distance, facet, points, normals)

    def occluded(
        self, origins: ArrayLike, targets: ArrayLike, *, tolerance: float = 1e-3
    ) -> BoolArray:
        """Return whether the mesh stands between origins (N, 3) and targets (N, 3), metres.

        Whatever lies within `tolerance` (metres) of the target does not hide it: targets
        usually lie on the surface. A pair that is not finite counts as occluded.
        """
        there = np.asarray(targets, dtype=np.float64)
        away = there - np.asarray(origins, dtype=np.float64)
        length = np.linalg.norm(away, axis=-1)
        hits = self.cast(np.broadcast_to(origins, away.shape), away)
        return (hits.distance < length - tolerance) | ~np.isfinite(length)

    def closest(self, points: ArrayLike) -> ClosestPoints:
        """Return the points of the mesh that are closest to `points` (N, 3), metres.

        Embree's candidate is found in single precision: where two places of the mesh are equally
        close within about 1e-6 of the radius, either may be returned.
        """
        import open3d  # noqa: PLC0415  # slow to import: only where it is needed

        places = np.asarray(points, dtype=np.float64) - self.center
        check_shape(places, (None, 3), "points")
        distance, near = np.empty(len(places)), np.empty((len(places), 3))
        facet = np.empty(len(places), dtype=np.int64)
        mesh, touching = (self._vertices, self._facets), (self._starts, self._around)
        for i in range(0, len(places), CHUNK):
            part = slice(i, i + CHUNK)
            tensor = open3d.core.Tensor.from_numpy(places[part].astype(np.float32))
            answer = self._scene.compute_closest_points(tensor)
            found = answer["primitive_ids"].numpy().astype(np.int64)
            out = (distance[part], facet[part], near[part])
            closest_near(np.ascontiguousarray(places[part]), found, mesh, touching, out)
        return ClosestPoints(distance, facet, near + self.center)

    def _cast_chunk(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return distance, facet and point of at most `CHUNK` rays."""
        starts, along, ahead = self._enter_sphere(origins - self.center, directions)
        facet = np.full(len(along), -1, dtype=np.int64)
        distance = np.full(len(along), np.nan)
        waiting = np.flatnonzero(np.isfinite(ahead))
        passed = np.zeros(len(along))
        for _ in range(MAX_STEPS):
            if not waiting.size:
                break
            begin = starts[waiting] + passed[waiting, None] * along[waiting]
            exact, which, rough = self._nearest(begin, along[waiting])
            distance[waiting], facet[waiting] = passed[waiting] + exact, which
            passed[waiting] += rough + SLACK * self.radius
            waiting = waiting[(which < 0) & np.isfinite(rough)]
        points = self.center + starts + distance[:, None] * along
        return distance + ahead, facet, points

    def _nearest(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the distance (N,) and facet (N,) of the nearer of two candidates for each ray.

        Embree is called twice, the second time with the ray displaced by the slack: a ray aimed at
        a vertex slips between its facets once in five hundred times. −1 where neither candidate is
        hit. The third array is Embree's distance to the first candidate (inf: none).
        """
        slack = SLACK * self.radius
        aside = np.cross(directions, np.eye(3)[np.argmin(np.abs(directions), axis=1)])
        distance = np.full(len(origins), np.nan)
        facet = np.full(len(origins), -1, dtype=np.int64)
        first = np.full(len(origins), np.inf)
        for begin in (origins, origins + slack * aside):
            rough, found = self._embree(begin, directions)
            exact, which = refine(
                (origins, directions, rough, found), (self._vertices, self._facets),
                (self._starts, self._around), (slack, GRAIN * self.radius),
            )  # fmt: skip
            nearer = (which >= 0) & ~(exact >= distance)
            distance[nearer], facet[nearer] = exact[nearer], which[nearer]
            first = np.minimum(first, rough)
        return distance, facet, first

    def _enter_sphere(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Move origins outside the bounding sphere onto it, in double precision.

        Embree's single precision would lose 0.5 mm at 7 km. Returns the new origins, the unit
        directions and how far each origin moved (NaN where the ray misses the sphere).
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            along = directions / np.linalg.norm(directions, axis=1, keepdims=True)
            nearest = -np.sum(origins * along, axis=1)
            # from the foot of the perpendicular, not from the squared distance of the origin:
            # that would cancel for an origin far away
            foot = origins + nearest[:, None] * along
            half = np.sqrt((1.01 * self.radius) ** 2 - np.sum(foot * foot, axis=1))
            leaves = nearest + half
            ahead = np.where(leaves >= 0, np.maximum(nearest - half, 0.0), np.nan)
        starts = np.where((ahead > 0)[:, None], foot - half[:, None] * along, origins)
        return starts, along, ahead

    def _embree(self, origins: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return single-precision distance (N,) and facet (N,), −1 for none, of rays."""
        import open3d  # noqa: PLC0415  # slow to import: only where rays are cast

        rays = np.hstack([origins, directions]).astype(np.float32)
        answer = self._scene.cast_rays(open3d.core.Tensor.from_numpy(rays))
        facet = answer["primitive_ids"].numpy().astype(np.int64)
        distance = answer["t_hit"].numpy().astype(np.float64)
        return distance, np.where(np.isfinite(distance), facet, -1)


def facets_around_vertices(facets: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return which facets touch each of `count` vertices, as a compressed list.

    Returns
    -------
    starts : (count + 1,) ndarray
        Facets of vertex v are ``around[starts[v]:starts[v + 1]]``.
    around : (3 F,) ndarray
        Facet indices.
    """
    corner = facets.ravel()
    starts = np.concatenate([[0], np.cumsum(np.bincount(corner, minlength=count))])
    return starts.astype(np.int64), (np.argsort(corner, kind="stable") // 3).astype(np.int64)


def _embree_scene(vertices: FloatArray, facets: IntArray) -> Any:
    """Return an Open3D ray-casting scene, its tree already built."""
    import open3d  # noqa: PLC0415  # slow to import: only where rays are cast

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor.from_numpy(vertices.astype(np.float32)),
        open3d.core.Tensor.from_numpy(facets.astype(np.uint32)),
    )
    # The first cast builds the tree; done here so that threads only read it.
    scene.cast_rays(open3d.core.Tensor.from_numpy(np.ones((1, 6), dtype=np.float32)))
    return scene


@compiled
def intersect(
    origin: FloatArray, direction: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> tuple[float, float]:
    """Return the distance along a ray to the plane of a triangle, and the margin to its edges.

    The second value is the smallest distance (metres, up to the slant of the edge) from the ray
    to the three edges, negative outside. The distance is NaN for a ray along the plane. Both are
    most precise if the ray begins near the triangle; it may begin behind it.
    """
    a0, a1, a2 = a[0] - origin[0], a[1] - origin[1], a[2] - origin[2]
    b0, b1, b2 = b[0] - origin[0], b[1] - origin[1], b[2] - origin[2]
    c0, c1, c2 = c[0] - origin[0], c[1] - origin[1], c[2] - origin[2]
    d0, d1, d2 = direction[0], direction[1], direction[2]
    ab = d0 * (a1 * b2 - a2 * b1) + d1 * (a2 * b0 - a0 * b2) + d2 * (a0 * b1 - a1 * b0)
    bc = d0 * (b1 * c2 - b2 * c1) + d1 * (b2 * c0 - b0 * c2) + d2 * (b0 * c1 - b1 * c0)
    ca = d0 * (c1 * a2 - c2 * a1) + d1 * (c2 * a0 - c0 * a2) + d2 * (c0 * a1 - c1 * a0)
    u0, u1, u2 = b0 - a0, b1 - a1, b2 - a2
    v0, v1, v2 = c0 - a0, c1 - a1, c2 - a2
    w0, w1, w2 = c0 - b0, c1 - b1, c2 - b2
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    facing = n0 * d0 + n1 * d1 + n2 * d2
    if facing == 0.0:
        return np.nan, -np.inf
    side = 1.0 if facing > 0 else -1.0
    inside = min(
        side * ab / np.sqrt(u0 * u0 + u1 * u1 + u2 * u2),
        side * bc / np.sqrt(w0 * w0 + w1 * w1 + w2 * w2),
        side * ca / np.sqrt(v0 * v0 + v1 * v1 + v2 * v2),
    )
    return (n0 * a0 + n1 * a1 + n2 * a2) / facing, inside


@compiled
def refine(
    rays: tuple[FloatArray, FloatArray, FloatArray, IntArray],
    mesh: tuple[FloatArray, IntArray],
    touching: tuple[IntArray, IntArray],
    limits: tuple[float, float],
) -> tuple[FloatArray, IntArray]:
    """Return the distance (N,) and facet (N,) that rays meet, at or next to a rough candidate.

    Parameters
    ----------
    rays : tuple
        Origins (N, 3), metres; unit directions (N, 3); rough distances (N,), metres, where the
        arithmetic starts, since coordinates are small there; facets found (N,), −1 for none.
    mesh : tuple
        Vertices (V, 3), metres, and facets (F, 3).
    touching : tuple
        Result of `facets_around_vertices`.
    limits : tuple
        Two distances, metres: neighbours (facets that share a vertex) are tested where the ray
        passes within the first of an edge; up to the second outside it counts as on the facet.

    Returns
    -------
    distance, facet : ndarrays (N,)
        Of the nearest facet ahead; NaN and −1 if none is met.
    """
    origins, directions, rough, found = rays
    vertices, facets = mesh
    starts, around = touching
    slack, grain = limits
    count = len(found)
    distance = np.full(count, np.nan)
    facet = np.full(count, -1, dtype=np.int64)
    for i in range(count):
        if found[i] < 0:
            continue
        start = origins[i] + rough[i] * directions[i]
        p, q, r = facets[found[i], 0], facets[found[i], 1], facets[found[i], 2]
        t, inside = intersect(start, directions[i], vertices[p], vertices[q], vertices[r])
        t += rough[i]
        if inside >= -grain and t >= 0.0:
            distance[i], facet[i] = t, found[i]
        if inside > slack and t >= 0.0:
            continue
        for corner in (p, q, r):
            for j in range(starts[corner], starts[corner + 1]):
                g = around[j]
                a, b, c = facets[g, 0], facets[g, 1], facets[g, 2]
                t, inside = intersect(start, directions[i], vertices[a], vertices[b], vertices[c])
                t += rough[i]
                if inside >= -grain and t >= 0.0 and not t >= distance[i]:
                    distance[i], facet[i] = t, g
    return distance, facet
