"""Registered mapolas as constraining heights on the grid of a maplet.

A mapola of about the same GSD gives heights of points. A cell of a coarser one says what the mean
height of the points in it is, and nothing about the detail between them, which is left to the
slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from lidar.mapola import Mapola
from spcola.arrays import AnyArray, BoolArray, FloatArray, IntArray
from spcola.heights import MeanConstraints
from spcola.maplet import Maplet, MapletGrid
from spcola.regrid import ProjectedMaplet, project_maplet

# A mapola whose GSD is larger than the grid's by this factor holds means, not points.
_COARSE = 1.5
# Metres: no cell is known better.
_LEAST_SIGMA = 1e-6


@dataclass(frozen=True, eq=False)
class Constraints:
    """Lidar heights on a grid.

    Parameters
    ----------
    height : (2q+1, 2q+1) ndarray
        Metres along Uz; NaN where no return fell.
    sigma : (2q+1, 2q+1) ndarray
        Independent from cell to cell, metres.
    count : (2q+1, 2q+1) int ndarray
        Returns behind each height, or in the coarse cell around the point.
    means : MeanConstraints, optional
        Heights of the cells of coarser mapolas, over the points without a height of their own.
    coarse : (2q+1, 2q+1) ndarray, optional
        Heights of those mapolas there, interpolated; NaN elsewhere.
    """

    height: FloatArray
    sigma: FloatArray
    count: AnyArray
    means: MeanConstraints | None = None
    coarse: FloatArray | None = None

    @property
    def known(self) -> BoolArray:
        """Mask of the points that a height, or a mean, holds."""
        points: BoolArray = np.isfinite(self.height)
        return points if self.coarse is None else points | np.isfinite(self.coarse)

    def subset(self, fraction: float, generator: np.random.Generator) -> Constraints:
        """Keep a random fraction (0 … 1) of the heights (Gaskell et al. §3.3), reproducibly."""
        if fraction >= 1.0:
            return self
        dropped = generator.random(self.height.shape) >= fraction
        return Constraints(
            np.where(dropped, np.nan, self.height),
            np.where(dropped, np.nan, self.sigma),
            np.where(dropped, 0, self.count),
            self.means,
            self.coarse,
        )


@dataclass(frozen=True)
class Candidate:
    """A registered mapola that may hold heights for a grid; read only if it is needed.

    Parameters
    ----------
    grid : MapletGrid
        Of the mapola, in SPC coordinates.
    load : callable
        Reads it, in SPC coordinates.
    """

    grid: MapletGrid
    load: Callable[[], Mapola]


def lidar_constraints(grid: MapletGrid, candidates: Iterable[Candidate]) -> Constraints:
    """Project registered mapolas onto `grid`, one height for each point.

    Overlapping mapolas hold the same returns, so averaging them would count returns twice. Each
    point takes the height of one: the first in order that holds it, so the caller puts the
    mapola of the same place first.

    Parameters
    ----------
    grid : MapletGrid
        In SPC coordinates.
    candidates : iterable of Candidate
        Best first. Those that reach no point that is still without a height are not read.

    Returns
    -------
    Constraints
        Metres along the grid's Uz; a sigma is carried over from the mapola's Uz [24–27].
    """
    height, sigma, coarse = (np.full(grid.shape, np.nan) for _ in range(3))
    count = np.zeros(grid.shape, dtype=np.int32)
    areas = _Areas(grid)
    for candidate in candidates:
        unknown = ~(np.isfinite(height) | np.isfinite(coarse))
        if not overlaps(grid, candidate.grid) or not _reaches(candidate.grid, grid, unknown):
            continue
        mapola = candidate.load()
        projected = mapola if candidate.grid is grid else project_maplet(mapola, grid)
        new = projected.valid & np.isfinite(projected.sigma) & unknown
        row, column = _nearest_cell(mapola.grid, grid, projected.height)
        count[new] = np.maximum(np.asarray(mapola.count)[row, column][new], 1)
        if mapola.grid.gsd > _COARSE * grid.gsd:
            coarse[new] = projected.height[new]
            areas.add(new, row * mapola.grid.size + column, projected)
        else:
            height[new], sigma[new] = projected.height[new], projected.sigma[new]
    if not areas.heights:
        return Constraints(height, sigma, count)
    return Constraints(height, sigma, count, areas.means(), coarse)


class _Areas:
    """Collects the cells of coarser mapolas over the points of a grid."""

    def __init__(self, grid: MapletGrid) -> None:
        self._labels = np.full(grid.shape, -1, dtype=np.int64)
        self.heights: list[float] = []
        self._weights: list[float] = []

    def add(self, new: BoolArray, cell: IntArray, surface: Maplet | ProjectedMaplet) -> None:
        """Add the cells that the `new` points (R, C) lie in, with the surface's mean there.

        Not the height of the cell's own middle: a cell may lie over the grid only in part.
        """
        number = np.unique(cell[new], return_inverse=True)[1]
        size = np.bincount(number)
        self._labels[new] = len(self.heights) + number
        self.heights += (np.bincount(number, surface.height[new]) / size).tolist()
        sigma = np.bincount(number, surface.sigma[new]) / size
        self._weights += (1.0 / np.maximum(sigma, _LEAST_SIGMA) ** 2).tolist()

    def means(self) -> MeanConstraints:
        """Return the constraints."""
        return MeanConstraints.of_labels(self._labels, self.heights, self._weights)


def _reaches(other: MapletGrid, grid: MapletGrid, unknown: BoolArray) -> bool:
    """Whether an `unknown` point of `grid` may lie over `other`, whatever its height is.

    Relief shifts a point sideways where the planes are inclined; up to a quarter of the grid's
    width of it is allowed for.
    """
    if not unknown.any():
        return False
    x, y, _ = other.project(grid.points(np.zeros(grid.shape))[unknown])
    tilt = float(np.linalg.norm(np.cross(grid.uz, other.uz)))
    limit = other.half_size + 0.5 * grid.half_size * grid.gsd / other.gsd * tilt
    return bool(((np.abs(x) <= limit) & (np.abs(y) <= limit)).any())


def overlaps(one: MapletGrid, other: MapletGrid) -> bool:
    """Whether two grids lie on the same side of the body and near enough to share points."""
    apart = float(np.linalg.norm(one.center - other.center))
    return apart < one.radius + other.radius and float(one.uz @ other.uz) > 0.0


def _nearest_cell(
    other: MapletGrid, grid: MapletGrid, height: FloatArray
) -> tuple[IntArray, IntArray]:
    """Row and column (R, C) of the cell of `other` nearest to each point of `grid` at `height`."""
    x, y, _ = other.project(grid.points(np.nan_to_num(height)))
    q = other.half_size
    column = np.clip(np.rint(x), -q, q).astype(np.intp) + q
    row = np.clip(np.rint(y), -q, q).astype(np.intp) + q
    return row, column
