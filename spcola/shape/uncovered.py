"""Surface samples that no grid covers yet, organised so that a further grid updates few of them.

Samples lie in cubes, each with its furthest sample. A grid can shorten only distances of samples
within the present largest distance of its centre, and that distance shrinks with every grid: cubes
beyond it are skipped.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray
from spcola.compilation import compiled, compiled_inline
from spcola.grids import MapletGrid
from spcola.shape.samples import Samples

FACING = 0.2
"""Least cosine between a surface's normal and Uz for the grid to count as covering it (78°)."""

COVERED = -1.0
"""Marks the distance of a covered sample."""


class Uncovered:
    """Samples of a surface, and their distances from the nearest centre of a grid.

    Parameters
    ----------
    samples : Samples
    side, depth : float
        A grid covers a sample within `side` of its centre along Ux and Uy and within `depth`
        along Uz, on a surface that faces Uz; metres.
    wanted : (N,) bool ndarray, optional
        Samples that are to be covered; the others only take part in mean normals.
    """

    def __init__(
        self, samples: Samples, side: float, depth: float, wanted: BoolArray | None = None
    ) -> None:
        self._limits = (side, depth)
        edge = 2.0 * max(side, depth)
        cube = np.floor(samples.points / edge).astype(np.int64)
        order = np.lexsort((cube[:, 2], cube[:, 1], cube[:, 0]))
        cube = cube[order]
        new = np.any(np.diff(cube, axis=0, prepend=cube[:1] - 1), axis=1)
        self._start = np.append(np.flatnonzero(new), len(order))
        self._middle = (cube[new] + 0.5) * edge
        self._wide = np.sqrt(0.75) * edge
        self._points, self._normals = samples.points[order], samples.normals[order]
        self._areas, self._number = samples.areas[order], order
        self._row = np.empty(len(order), dtype=np.int64)
        self._row[order] = np.arange(len(order))
        self._distance = np.full(len(order), np.inf)
        if wanted is not None:
            self._distance[~wanted[order]] = COVERED
        self._furthest = self._start[:-1].copy()
        self._far = np.inf

    @property
    def distance(self) -> FloatArray:
        """Distance (N,) of the samples to the nearest centre, squared, or `COVERED`."""
        result = np.empty(len(self._number))
        result[self._number] = self._distance
        return result

    def cover(self, grid: MapletGrid, index: int) -> int:
        """Add a grid centred on the sample `index`; return the next sample, or −1 if none is left.

        The sample itself always counts as covered. The next is the one furthest from all centres,
        the first of them if several are.
        """
        self._far, following = _cover(
            (self._points, self._normals, self._number, self._distance),
            (self._start, self._middle, self._furthest),
            (self._far, self._wide),
            (grid.center, grid.axes),
            self._limits,
            index,
        )
        return int(following)

    def mean_normal(self, index: int, radius: float) -> FloatArray:
        """Return the unit mean normal (3,) around the sample `index`, by area.

        Averages all samples within `radius` metres that face the same side, covered or not; returns
        the sample's own normal where the mean would not face it.
        """
        row = self._row[index]
        own = self._normals[row]
        mean = _sum_of_normals(
            (self._points, self._normals, self._areas),
            (self._start, self._middle),
            self._wide,
            row,
            radius,
        )
        mean = mean / np.linalg.norm(mean)
        return mean if mean @ own > 2 * FACING else own


@compiled
def _cover(
    samples: tuple[FloatArray, FloatArray, IntArray, FloatArray],
    cubes: tuple[IntArray, FloatArray, IntArray],
    reaches: tuple[float, float],
    frame: tuple[FloatArray, FloatArray],
    limits: tuple[float, float],
    own: int,
) -> tuple[float, int]:
    """Mark the samples that a grid covers, and update each cube's furthest; both in place.

    `reaches` are the largest distance, squared, and half a cube's diagonal. Returns the new
    largest distance and the number of its sample, the first of several; −1 if none is left.
    """
    points, normals, number, distance = samples
    start, middle, furthest = cubes
    center, _ = frame
    most, wide = reaches
    reach = np.sqrt(max(most, 2.0 * limits[0] ** 2 + limits[1] ** 2)) + wide
    far, first = COVERED, -1
    for b in range(len(furthest)):
        x, y, z = middle[b, 0] - center[0], middle[b, 1] - center[1], middle[b, 2] - center[2]
        if x * x + y * y + z * z <= reach * reach:
            best = start[b]
            for i in range(start[b], start[b + 1]):
                if number[i] == own:
                    distance[i] = COVERED
                if distance[i] >= 0.0:
                    distance[i] = min(distance[i], _left_over(points, normals, i, frame, limits))
                if distance[i] > distance[best]:
                    best = i
            furthest[b] = best
        # Of equal distances the smallest sample number wins, whatever the order of the cubes.
        best = furthest[b]
        if distance[best] > far or (distance[best] == far and number[best] < first):
            far, first = distance[best], number[best]
    return far, first


@compiled_inline
def _left_over(
    points: FloatArray,
    normals: FloatArray,
    i: int,
    frame: tuple[FloatArray, FloatArray],
    limits: tuple[float, float],
) -> float:
    """Distance of a sample from a grid's centre, squared; `COVERED` if the grid covers it."""
    center, axes = frame
    side, depth = limits
    dx, dy, dz = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
    squared = dx * dx + dy * dy + dz * dz
    if squared > 2.0 * side * side + depth * depth:
        return squared
    along_x = dx * axes[0, 0] + dy * axes[0, 1] + dz * axes[0, 2]
    along_y = dx * axes[1, 0] + dy * axes[1, 1] + dz * axes[1, 2]
    height = dx * axes[2, 0] + dy * axes[2, 1] + dz * axes[2, 2]
    cosine = normals[i, 0] * axes[2, 0] + normals[i, 1] * axes[2, 1] + normals[i, 2] * axes[2, 2]
    near = abs(along_x) <= side and abs(along_y) <= side and abs(height) <= depth
    return COVERED if near and cosine >= FACING else squared


@compiled
def _sum_of_normals(
    samples: tuple[FloatArray, FloatArray, FloatArray],
    cubes: tuple[IntArray, FloatArray],
    wide: float,
    own: int,
    radius: float,
) -> FloatArray:
    """Normals (3,) times areas, summed over samples within `radius` of one and on its side."""
    points, normals, areas = samples
    start, middle = cubes
    total = np.zeros(3)
    reach = radius + wide
    for b in range(len(middle)):
        x, y, z = middle[b, 0], middle[b, 1], middle[b, 2]
        x, y, z = x - points[own, 0], y - points[own, 1], z - points[own, 2]
        if x * x + y * y + z * z > reach * reach:
            continue
        for i in range(start[b], start[b + 1]):
            squared = same_side = 0.0
            for axis in range(3):
                squared += (points[i, axis] - points[own, axis]) ** 2
                same_side += normals[i, axis] * normals[own, axis]
            if squared <= radius * radius and same_side > 0.0:
                for axis in range(3):
                    total[axis] += areas[i] * normals[i, axis]
    return total
