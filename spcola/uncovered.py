"""What of a surface no grid covers yet, kept so that a further grid touches little of it.

Samples lie in cubes, each of which knows its own furthest. A grid can bring nearer only samples
that are within the present largest distance of its centre, and that distance shrinks with every
grid: cubes beyond it are passed over.
"""

from __future__ import annotations

import numpy as np

from spcola.arrays import FloatArray, IntArray
from spcola.kernel import kernel
from spcola.maplet import MapletGrid

FACING = 0.2
"""Least cosine between a surface's normal and Uz for the grid to count as covering it (78°)."""

COVERED = -1.0
"""Stands for the distance of a sample that a grid covers."""


class Uncovered:
    """Samples of a surface, and how far each is from the nearest centre of a grid.

    Parameters
    ----------
    points, normals : (N, 3) ndarrays
        Metres; unit vectors outward.
    side, depth : float
        A grid covers what lies within `side` of its centre along Ux and Uy and within `depth`
        along Uz, and faces Uz; metres.
    """

    def __init__(self, points: FloatArray, normals: FloatArray, side: float, depth: float) -> None:
        self._limits = (side, depth)
        edge = max(side, depth)
        cube = np.floor(points / edge).astype(np.int64)
        order = np.lexsort((cube[:, 2], cube[:, 1], cube[:, 0]))
        cube = cube[order]
        new = np.any(np.diff(cube, axis=0, prepend=cube[:1] - 1), axis=1)
        self._start = np.append(np.flatnonzero(new), len(points))
        self._middle = (cube[new] + 0.5) * edge
        self._wide = np.sqrt(0.75) * edge
        self._points, self._normals, self._number = points[order], normals[order], order
        self._distance = np.full(len(points), np.inf)
        self._furthest = self._start[:-1].copy()

    @property
    def distance(self) -> FloatArray:
        """Distance (N,) of the samples to the nearest centre, squared, or `COVERED`."""
        result = np.empty(len(self._number))
        result[self._number] = self._distance
        return result

    def cover(self, grid: MapletGrid, index: int) -> int:
        """Take a grid in that stands on the sample `index`; return the next, or −1 if none is left.

        Its own grid covers a sample, whatever rounding says. The next is the one furthest from
        all centres, the first of them if several are.
        """
        _cover(
            (self._points, self._normals, self._number, self._distance),
            (self._start, self._middle, self._furthest),
            self._wide,
            (grid.center, grid.axes),
            self._limits,
            index,
        )
        far = self._distance[self._furthest]
        if far.max() == COVERED:
            return -1
        return int(self._number[self._furthest[far == far.max()]].min())


@kernel
def _cover(
    samples: tuple[FloatArray, FloatArray, IntArray, FloatArray],
    cubes: tuple[IntArray, FloatArray, IntArray],
    wide: float,
    frame: tuple[FloatArray, FloatArray],
    limits: tuple[float, float],
    own: int,
) -> None:
    """Mark what a grid covers, and note each cube's furthest; both in place."""
    points, normals, number, distance = samples
    start, middle, furthest = cubes
    center, axes = frame
    side, depth = limits
    reached = 2.0 * side * side + depth * depth
    most = 0.0
    for b in range(len(furthest)):
        most = max(most, distance[furthest[b]])
    reach = np.sqrt(max(most, reached)) + wide
    for b in range(len(furthest)):
        x, y, z = middle[b, 0] - center[0], middle[b, 1] - center[1], middle[b, 2] - center[2]
        if x * x + y * y + z * z > reach * reach:
            continue
        best = start[b]
        for i in range(start[b], start[b + 1]):
            if number[i] == own:
                distance[i] = COVERED
            if distance[i] >= 0.0:
                dx, dy, dz = (
                    points[i, 0] - center[0],
                    points[i, 1] - center[1],
                    points[i, 2] - center[2],
                )
                squared = dx * dx + dy * dy + dz * dz
                distance[i] = min(distance[i], squared)
                if squared <= reached:
                    along_x = dx * axes[0, 0] + dy * axes[0, 1] + dz * axes[0, 2]
                    along_y = dx * axes[1, 0] + dy * axes[1, 1] + dz * axes[1, 2]
                    h = dx * axes[2, 0] + dy * axes[2, 1] + dz * axes[2, 2]
                    cosine = (
                        normals[i, 0] * axes[2, 0]
                        + normals[i, 1] * axes[2, 1]
                        + normals[i, 2] * axes[2, 2]
                    )
                    near = abs(along_x) <= side and abs(along_y) <= side and abs(h) <= depth
                    if near and cosine >= FACING:
                        distance[i] = COVERED
            if distance[i] > distance[best]:
                best = i
        furthest[b] = best
