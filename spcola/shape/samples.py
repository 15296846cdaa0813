"""Samples spread over the surface of a shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spcola.arrays import FloatArray
from spcola.errors import InvalidValueError
from spcola.shape.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Samples:
    """Points (N, 3), metres, spread over a surface, with unit normals and areas (N,), m²."""

    points: FloatArray
    normals: FloatArray
    areas: FloatArray


def sample_surface(mesh: Mesh, step: float) -> Samples:
    """Return points such that every surface point has one on its facet within `step` metres.

    Each facet is cut into k² equal triangles whose centres are taken; k is chosen so that no
    point of such a triangle is further than `step` from its centre.

    Parameters
    ----------
    mesh : Mesh
    step : float
        Metres.

    Raises
    ------
    InvalidValueError
        If `step` is not positive or no facet has an area.
    """
    if not (np.isfinite(step) and step > 0):
        raise InvalidValueError(f"must be positive, not {step} m", "step")
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    facets = np.flatnonzero(area > 0)
    if not facets.size:
        raise InvalidValueError("has no area to cover", mesh.name)
    corners = mesh.corners[facets]
    reach = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    cuts = np.maximum(1, np.ceil(reach / step)).astype(np.int64)
    points, owners = [], []
    for k in np.unique(cuts):
        chosen = np.flatnonzero(cuts == k)
        weights = _sub_triangle_centers(int(k))
        points.append(np.einsum("wk,fkj->fwj", weights, corners[chosen]).reshape(-1, 3))
        owners.append(np.repeat(chosen, len(weights)))
    owner = np.concatenate(owners)
    return Samples(
        np.concatenate(points), mesh.normals[facets[owner]], (area[facets] / cuts**2)[owner]
    )


def _sub_triangle_centers(k: int) -> FloatArray:
    """Return barycentric coordinates (k², 3) of the centres of k² equal parts of a triangle."""
    i, j = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
    upright = i + j <= k - 1
    turned = i + j <= k - 2
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / k
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / k
    return np.stack([first, second, 1 - first - second], axis=1)
