"""A covering of a body with maplet grids, made from its shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from spcola.arrays import BoolArray, FloatArray
from spcola.errors import InvalidValueError
from spcola.kernel import kernel
from spcola.maplet import MapletGrid
from spcola.mesh import Mesh
from spcola.rays import RayCaster

SAMPLES_PER_HALF = 10
"""Surface samples along half a side of a grid; finer costs time and saves few grids."""

FACING = 0.2
"""Least cosine between a surface's normal and Uz for the grid to count as covering it (78°)."""


COVERED = -1.0
"""Stands for the distance of a sample that a grid covers."""


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
    distance = np.full(len(samples.points), np.inf)
    grids: list[MapletGrid] = []
    index = 0
    while index >= 0:
        grid = MapletGrid.facing(
            samples.points[index], _mean_normal(samples, tree, index, half), gsd, half_size
        )
        grids.append(grid)
        distance[index] = COVERED  # its own grid covers it, whatever rounding says: the loop ends
        index = cover(
            samples.points, samples.normals, distance, grid.center, grid.axes, (limit, half - step)
        )
    return grids


@kernel
def cover(
    points: FloatArray,
    normals: FloatArray,
    distance: FloatArray,
    center: FloatArray,
    axes: FloatArray,
    limits: tuple[float, float],
) -> int:
    """Mark the samples that a grid covers, and return the furthest that is not covered (or −1).

    `distance` (N,) is each sample's distance to the nearest centre, squared, or `COVERED`; it is
    changed in place. `limits` are the `side` and `depth` of `inside`.
    """
    side, depth = limits
    furthest = -1
    most = -1.0
    for i in range(len(points)):
        if distance[i] < 0.0:
            continue
        dx = points[i, 0] - center[0]
        dy = points[i, 1] - center[1]
        dz = points[i, 2] - center[2]
        squared = dx * dx + dy * dy + dz * dz
        if squared <= 2.0 * side * side + depth * depth:
            x = dx * axes[0, 0] + dy * axes[0, 1] + dz * axes[0, 2]
            y = dx * axes[1, 0] + dy * axes[1, 1] + dz * axes[1, 2]
            h = dx * axes[2, 0] + dy * axes[2, 1] + dz * axes[2, 2]
            cosine = (
                normals[i, 0] * axes[2, 0] + normals[i, 1] * axes[2, 1] + normals[i, 2] * axes[2, 2]
            )
            if abs(x) <= side and abs(y) <= side and abs(h) <= depth and cosine >= FACING:
                distance[i] = COVERED
                continue
        distance[i] = min(distance[i], squared)
        if distance[i] > most:
            most = distance[i]
            furthest = i
    return furthest


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
