"""Points fitted to a surface of points: turned, moved and scaled until the distances are least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from spcola.arrays import BoolArray, FloatArray
from spcola.math.robust import biweight, mad

_NEIGHBOURS = 9
# Of a point further along the surface than so many steps from any of its points nothing is known.
_BEYOND = 2.5
# Points further from the surface than this, in radii, count as unknown there.
_REACH = 0.25
_NEAR_ENOUGH = 0.3
# Where the distances leave a parameter free it stays within this: radians, radii, and of 1.
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
    """A surface of points (N, 3), metres, thinned to one in each cube of an edge of `step`.

    Attributes
    ----------
    points, normals : (M, 3) ndarrays
        The thinned points, means of those in their cubes, and the unit normals of the planes
        through their neighbours, of either sign.
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
        """Return the distances (N,) of points from the nearest planes, and these' normals (N, 3).

        NaN where the surface is not known.
        """
        # Far from the surface the very nearest point is dear, and says no more than a near one.
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

    Points that lie far off, for the others, count for nothing.

    Returns
    -------
    Placement
    float
        Robust standard deviation of the distances, metres; infinite where hardly any is known.
    float
        Share of the points where the surface is known.
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
    """Rotation (3,), rad, shift (3,), in radii, and relative change of scale that fit best."""
    spread = max(float(mad(distance)), 1e-6 * radius)
    weight = biweight(distance / spread) / spread**2
    lever = np.hstack([
        np.cross(points, normal), radius * normal,
        np.einsum("ij,ij->i", points, normal)[:, None],
    ])  # fmt: skip
    # A twentieth of the points as independent of each other: relief holds together.
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
    """Means of the points in each cube of an edge of `step`."""
    cube = np.floor(points / step).astype(np.int64)
    cube -= cube.min(axis=0)
    size = cube.max(axis=0) + 1
    number = (cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2]
    _, which, count = np.unique(number, return_inverse=True, return_counts=True)
    mean: FloatArray = np.stack(
        [np.bincount(which, weights=points[:, axis]) / count for axis in range(3)], axis=1
    )
    return mean
