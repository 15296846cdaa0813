"""Registered mapolas as constraining heights on the grid of a maplet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from lidar.mapola import Mapola
from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.maplet import MapletGrid
from spcola.regrid import project_maplet


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
        Returns behind each height.
    """

    height: FloatArray
    sigma: FloatArray
    count: AnyArray

    def subset(self, fraction: float, generator: np.random.Generator) -> Constraints:
        """Keep a random fraction (0 … 1) of the heights (Gaskell et al. §3.3), reproducibly."""
        if fraction >= 1.0:
            return self
        dropped = generator.random(self.height.shape) >= fraction
        return Constraints(
            np.where(dropped, np.nan, self.height),
            np.where(dropped, np.nan, self.sigma),
            np.where(dropped, 0, self.count),
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
    height = np.full(grid.shape, np.nan)
    sigma = np.full(grid.shape, np.nan)
    count = np.zeros(grid.shape, dtype=np.int32)
    for candidate in candidates:
        unknown = ~np.isfinite(height)
        if not overlaps(grid, candidate.grid) or not _reaches(candidate.grid, grid, unknown):
            continue
        mapola = candidate.load()
        projected = mapola if candidate.grid is grid else project_maplet(mapola, grid)
        new = projected.valid & np.isfinite(projected.sigma) & unknown
        height[new] = projected.height[new]
        sigma[new] = projected.sigma[new]
        count[new] = np.maximum(_nearest_count(mapola, grid, height)[new], 1)
    return Constraints(height, sigma, count)


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


def _nearest_count(mapola: Mapola, grid: MapletGrid, height: FloatArray) -> AnyArray:
    """Count of the mapola's cell nearest to each point of `grid` that lies at `height`."""
    x, y, _ = mapola.grid.project(grid.points(np.nan_to_num(height)))
    q = mapola.grid.half_size
    column = np.clip(np.rint(x), -q, q).astype(np.intp) + q
    row = np.clip(np.rint(y), -q, q).astype(np.intp) + q
    return np.asarray(mapola.count)[row, column]
