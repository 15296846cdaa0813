"""Fit of points to a surface of points by rotation, translation and scale (point to plane)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import biweight, mad

_NEIGHBOURS = 9
# The surface is not known further than this many steps along it from any of its points.
_BEYOND = 2.5
# Points further from the surface than this, in radii, are not compared with it.
_REACH = 0.25
_NEAR_ENOUGH = 0.3
# Prior sigmas of parameters that distances do not determine: radians, radii, relative scale.
_PRIOR = np.array([0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])


@dataclass(frozen=True, eq=False)
class Placement:
    """``x → translation + scale · matrix · x``; the matrix is orthogonal and may be mirrored."""

    matrix: FloatArray
    translation: FloatArray
    scale: float

    def apply(self, points: FloatArray) -> FloatArray:
        """Place points (N, 3), metres."""
        placed: FloatArray = self.scale * (points @ self.matrix.T) + self.translation
        return placed


class PointSurface:
    """A surface of points (N, 3), metres, thinned to one in each cube with edge `step`.

    Attributes
    ----------
    points, normals : (M, 3) ndarrays
        The means of the points in each cube, and the unit normals (of either sign) of the planes
        through their neighbours.
    """

    def __init__(self, points: FloatArray, step: float) -> None:
        self.step = step
        self.points = _thinned(points, step)
        self._tree = cKDTree(self.points)
        self._reach = _REACH * float(np.sqrt(3.0 * np.mean(self.points**2)))
        neighbours = min(_NEIGHBOURS, len(self.points))
        _, rows = self._tree.query(self.points, k=neighbours)
        near = self.points[rows.reshape(len(self.points), neighbours)]
        near = near - near.mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
        self.normals: FloatArray = vectors[:, :, 0]

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances (N,) of points from the nearest planes, and their normals (N, 3).

        NaN where the surface is not known.
        """
        # Far from the surface a near point serves as well as the nearest, and is found faster.
        away, row = self._tree.query(points, eps=_NEAR_ENOUGH, distance_upper_bound=self._reach)
        row = np.minimum(row, len(self.points) - 1)
        normal = self.normals[row]
        distance = np.einsum("ij,ij->i", points - self.points[row], normal)
        along = np.sqrt(np.maximum(away**2 - distance**2, 0.0))
        known = (along <= _BEYOND * self.step) & np.isfinite(away)
        return np.where(known, distance, np.nan), normal


def fit_placement(
    surface: PointSurface, points: FloatArray, start: Placement, *, steps: int
) -> tuple[Placement, float, float]:
    """Fit points (N, 3) to a surface by at most `steps` Gauss-Newton steps.

    Outliers get weight 0.

    Parameters
    ----------
    surface : PointSurface
    points : (N, 3) ndarray
        Metres.
    start : Placement
    steps : int

    Returns
    -------
    Placement
    float
        Robust standard deviation of the distances, metres; infinite if too few are known.
    float
        Share of the points for which the surface is known.
    """
    at = start
    radius = float(np.sqrt(np.mean(surface.points**2) * 3.0))
    for _ in range(steps):
        placed = at.apply(points)
        distance, normal = surface.distances(placed)
        known = np.isfinite(distance)
        if np.count_nonzero(known) < 2 * len(_PRIOR):
            return at, np.inf, float(known.mean())
        step = _step(placed[known], distance[known], normal[known], radius)
        at = _moved(at, step, radius)
        if np.abs(step).max() < 1e-6:
            break
    distance, _ = surface.distances(at.apply(points))
    known = np.isfinite(distance)
    return at, _spread(distance, known), float(known.mean())


def _step(
    points: FloatArray, distance: FloatArray, normal: FloatArray, radius: float
) -> FloatArray:
    """Best step: rotation (3,), rad, shift (3,), in radii, and relative change of scale."""
    spread = max(float(mad(distance)), 1e-6 * radius)
    weight = biweight(distance / spread) / spread**2
    lever = np.hstack([
        np.cross(points, normal), radius * normal,
        np.einsum("ij,ij->i", points, normal)[:, None],
    ])  # fmt: skip
    # Relief is correlated: a twentieth of the points count as independent.
    normals = (lever.T * weight) @ lever / 20.0 + np.diag(_PRIOR**-2)
    step: FloatArray = np.linalg.solve(normals, -(lever.T @ (weight * distance)) / 20.0)
    return step


def _moved(at: Placement, step: FloatArray, radius: float) -> Placement:
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    growth = float(np.clip(1.0 + step[6], 0.8, 1.25))
    moved = growth * (turn @ at.translation) + radius * step[3:6]
    return Placement(turn @ at.matrix, moved, growth * at.scale)


def _spread(distance: FloatArray, known: BoolArray) -> float:
    if np.count_nonzero(known) < 2 * len(_PRIOR):
        return np.inf
    return float(1.4826 * np.median(np.abs(distance[known])))


def _thinned(points: FloatArray, step: float) -> FloatArray:
    """Means of the points in each cube with edge `step`."""
    cube = np.floor(points / step).astype(np.int64)
    cube -= cube.min(axis=0)
    size = cube.max(axis=0) + 1
    number = (cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2]
    _, which, count = np.unique(number, return_inverse=True, return_counts=True)
    mean: FloatArray = np.stack(
        [np.bincount(which, weights=points[:, axis]) / count for axis in range(3)], axis=1
    )
    return mean
