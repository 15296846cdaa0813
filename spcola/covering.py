"""A covering of a body with maplet grids, made from its shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.maplet import MapletGrid
from spcola.mesh import Mesh
from spcola.rays import RayCaster
from spcola.uncovered import FACING, Uncovered

SAMPLES_PER_HALF = 10
"""Surface samples along half a side of a grid; finer costs time and saves few grids."""


def covering(
    shape: RayCaster | Mesh, gsd: float, half_size: int, *, overlap: float = 0.2
) -> list[MapletGrid]:
    """Return grids such that every surface point of a shape lies in at least one.

    A point lies in a grid if it projects into its square, no further from the plane than half
    a side, on a facet that faces Uz (at 78° or less). Each next grid stands on the point
    not yet covered that is furthest from all centres, facing the mean normal around it: centres
    come out evenly spaced without any assumption about the shape.

    Parameters
    ----------
    shape : RayCaster or Mesh
        Body-fixed.
    gsd : float
        Of the grids, metres.
    half_size : int
        q of the grids.
    overlap : float
        Share of the half-side, 0 … 0.8: every surface point lies at least this far inside the
        rim of a grid that covers it.

    Raises
    ------
    InvalidValueError
        If a setting is out of range or the shape has no area.
    """
    mesh = shape.mesh if isinstance(shape, RayCaster) else shape
    if not 0 <= overlap <= 0.8:
        raise InvalidValueError(f"must lie between 0 and 0.8, not {overlap}", "overlap")
    half = gsd * half_size
    step = half * (1 - overlap) / SAMPLES_PER_HALF
    samples = sample_surface(mesh, step)
    limit = half * (1 - overlap) - step
    tree = cKDTree(samples.points)
    uncovered = Uncovered(samples.points, samples.normals, limit, half - step)
    grids: list[MapletGrid] = []
    index = 0
    while index >= 0:
        grid = MapletGrid.facing(
            samples.points[index], _mean_normal(samples, tree, index, half), gsd, half_size
        )
        grids.append(grid)
        index = uncovered.cover(grid, index)
    return grids


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


def inside(
    grid: MapletGrid, points: FloatArray, normals: FloatArray, *, side: float, depth: float
) -> BoolArray:
    """Return which points (N, 3) lie within `side` of the centre along Ux and Uy and face Uz.

    `depth` limits the distance from the reference plane; both in metres.
    """
    x, y, height = grid.project(points)
    return (
        (np.maximum(np.abs(x), np.abs(y)) * grid.gsd <= side)
        & (np.abs(height) <= depth)
        & (normals @ grid.uz >= FACING)
    )


def _sub_triangle_centers(k: int) -> FloatArray:
    """Return barycentric coordinates (k², 3) of the centres of k² equal parts of a triangle."""
    i, j = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
    upright = i + j <= k - 1
    turned = i + j <= k - 2
    first = np.concatenate([i[upright] + 1 / 3, i[turned] + 2 / 3]) / k
    second = np.concatenate([j[upright] + 1 / 3, j[turned] + 2 / 3]) / k
    return np.stack([first, second, 1 - first - second], axis=1)


def _mean_normal(samples: Samples, tree: cKDTree, index: int, radius: float) -> FloatArray:
    """Return the mean normal around a sample, or its own where it would not face that."""
    own = samples.normals[index]
    near = np.asarray(tree.query_ball_point(samples.points[index], radius))
    same_side = near[samples.normals[near] @ own > 0]
    mean = samples.areas[same_side] @ samples.normals[same_side]
    mean = mean / np.linalg.norm(mean)
    return mean if mean @ own > 2 * FACING else own
