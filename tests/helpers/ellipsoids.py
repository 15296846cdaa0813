"""Meshes of ellipsoids, and points on meshes."""

from __future__ import annotations

import numpy as np

from spcola.shape import Mesh


def ellipsoid(a: float, b: float, c: float, step: int = 24) -> Mesh:
    lat, lon = np.linspace(-90, 90, step + 1)[1:-1], np.arange(2 * step) * 180 / step
    grid_lat, grid_lon = np.meshgrid(np.radians(lat), np.radians(lon), indexing="ij")
    level = np.cos(grid_lat)
    ring = np.stack([level * np.cos(grid_lon), level * np.sin(grid_lon), np.sin(grid_lat)], axis=-1)
    vertices = np.vstack([ring.reshape(-1, 3), [[0, 0, -1], [0, 0, 1]]]) * [a, b, c]
    index = np.arange(ring[..., 0].size).reshape(ring.shape[:2])
    east = np.roll(index, -1, axis=1)
    south, north = index.size, index.size + 1
    return Mesh(
        vertices,
        np.vstack([
            np.stack([index[:-1], east[:-1], east[1:]], axis=-1).reshape(-1, 3),
            np.stack([index[:-1], east[1:], index[1:]], axis=-1).reshape(-1, 3),
            np.stack([np.full(2 * step, south), east[0], index[0]], axis=-1),
            np.stack([np.full(2 * step, north), index[-1], east[-1]], axis=-1),
        ]),
    )  # fmt: skip


def random_points(mesh: Mesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    facet = rng.choice(len(area), count, p=area / area.sum())
    inside_facet = rng.dirichlet([1.0, 1.0, 1.0], count)
    points = np.einsum("nk,nkj->nj", inside_facet, mesh.corners[facet])
    return points, mesh.normals[facet]
