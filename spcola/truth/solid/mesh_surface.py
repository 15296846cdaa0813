"""The surface of a mesh, as images and shadows ask for it."""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.shape import RayCaster
from spcola.truth.body import SurfacePoints
from spcola.truth.solid.refining import vertex_normals

# Distance from the ground at which a ray to the light begins, over the radius of the mesh.
_LIFT = 1e-8


class MeshSurface:
    """A mesh with normals that change smoothly over its facets.

    Rays hit the facets themselves. Normals are interpolated between those of the vertices, so that
    single facets do not show in images.

    Parameters
    ----------
    caster : RayCaster
        Of a closed mesh.
    """

    def __init__(self, caster: RayCaster) -> None:
        self.caster = caster
        mesh = caster.mesh
        self._normals = vertex_normals(mesh.vertices, mesh.facets)
        self._reach = float(np.sqrt(np.max(np.sum(mesh.vertices**2, axis=1))))

    def outside(self, directions: FloatArray) -> FloatArray:
        """Return points (N, 3) beyond the surface in the `directions` (N, 3), metres."""
        lengths = np.sqrt(np.sum(np.asarray(directions) ** 2, axis=1))
        points: FloatArray = 1.5 * self._reach * directions / lengths[:, None]
        return points

    def radius(self, directions: FloatArray) -> FloatArray:
        """Return the greatest radius (N,), metres, in the `directions` (N, 3)."""
        starts = self.outside(np.asarray(directions, dtype=np.float64))
        hits = self.caster.cast(starts, -starts)
        return 1.5 * self._reach - hits.distance

    def cast(self, origins: FloatArray, directions: FloatArray) -> SurfacePoints:
        """Return distance, points and smooth normals of the first hits of rays.

        Parameters
        ----------
        origins : (N, 3) or (3,) array_like
            Body-fixed, metres; outside.
        directions : (N, 3) ndarray
            Of any length.
        """
        hits = self.caster.cast(origins, directions)
        return SurfacePoints(hits.distance, hits.points, self.normals_at(hits.points, hits.facet))

    def occluded(self, points: FloatArray, toward: FloatArray) -> BoolArray:
        """Return whether ground occludes the directions from points of the ground.

        Parameters
        ----------
        points : (N, 3) ndarray
            Body-fixed, metres, on the surface.
        toward : (3,) or (N, 3) array_like
            Direction to the light or the camera, of any length.
        """
        starts = np.asarray(points, dtype=np.float64)
        beams = np.broadcast_to(np.asarray(toward, dtype=np.float64), starts.shape)
        beams = beams / np.sqrt(np.sum(beams**2, axis=1))[:, None]
        lifted = starts + _LIFT * self.caster.radius * beams
        return self.caster.cast(lifted, beams).hit

    def normals_at(self, points: FloatArray, facets: IntArray) -> FloatArray:
        """Return smooth unit normals (N, 3) at points on `facets` (N,); NaN where one is −1."""
        normals = np.full(points.shape, np.nan)
        known = np.flatnonzero(facets >= 0)
        corner = self.caster.mesh.facets[facets[known]]
        a, b, c = (self.caster.mesh.vertices[corner[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        area = np.sum(across**2, axis=1)
        p = points[known]
        v = np.sum(np.cross(p - a, c - a) * across, axis=1) / area
        w = np.sum(np.cross(b - a, p - a) * across, axis=1) / area
        shares = np.stack([1.0 - v - w, v, w], axis=1)
        mixed = np.einsum("ij,ijk->ik", shares, self._normals[corner])
        normals[known] = mixed / np.sqrt(np.sum(mixed**2, axis=1))[:, None]
        return normals
