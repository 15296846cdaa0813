"""Registered mapolas as constraining heights on the grid of a maplet.

A mapola of about the same GSD gives heights of points. A cell of a coarser mapola gives the mean
height of the points in it; the detail between them is determined by the slopes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from lidar.gridding import Mapola, at_grid_points
from spcola.arrays import AnyArray, BoolArray, FloatArray, IntArray
from spcola.grids import MapletGrid, overlaps, project_maplet
from spcola.grids.bending import CELL_SHARE
from spcola.heights import MeanConstraints

# A mapola whose GSD is larger than the grid's by this factor gives means, not points.
_COARSE = 1.5
# Share of its points that a cell must have on the grid to count as whole.
_WHOLE = 0.9
# Smallest sigma of a cell, metres.
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
        Returns that contribute to each height, or to the coarse cell around the point.
    means : MeanConstraints, optional
        Heights of the cells of coarser mapolas, over the points without a height of their own.
    coarse : (2q+1, 2q+1) ndarray, optional
        Heights of those mapolas there, interpolated; NaN elsewhere.
    blur : (2q+1, 2q+1) ndarray, optional
        Variance along each axis of what each height is a mean over, m²; without it heights are
        those of the points.
    """

    height: FloatArray
    sigma: FloatArray
    count: AnyArray
    means: MeanConstraints | None = None
    coarse: FloatArray | None = None
    blur: FloatArray | None = None

    @property
    def known(self) -> BoolArray:
        """Mask of the points that have a height or lie in a mean."""
        points: BoolArray = np.isfinite(self.height)
        return points if self.coarse is None else points | np.isfinite(self.coarse)

    def subset(self, fraction: float, generator: np.random.Generator) -> Constraints:
        """Keep a random fraction (0 … 1) of the heights (Gaskell et al. §3.3), reproducibly.

        Parameters
        ----------
        fraction : float
            0 … 1.
        generator : numpy Generator
        """
        if fraction >= 1.0:
            return self
        return self.without(generator.random(self.height.shape) >= fraction)

    def without(self, dropped: BoolArray) -> Constraints:
        """Leave out the heights of the points (R, C) `dropped`; means remain."""
        return replace(
            self,
            height=np.where(dropped, np.nan, self.height),
            sigma=np.where(dropped, np.nan, self.sigma),
            count=np.where(dropped, 0, self.count),
        )


@dataclass(frozen=True)
class RegisteredMapola:
    """A registered mapola that may have heights for a grid; read only if it is needed.

    Parameters
    ----------
    grid : MapletGrid
        Of the mapola, in SPC coordinates.
    load : callable
        Reads it, in SPC coordinates.
    """

    grid: MapletGrid
    load: Callable[[], Mapola]


def lidar_constraints(
    grid: MapletGrid, candidates: Iterable[RegisteredMapola], *, as_means: bool = False
) -> Constraints:
    """Project registered mapolas onto `grid`, one height for each point.

    Overlapping mapolas contain the same returns, so averaging them would count returns twice. Each
    point has the height of the first mapola that covers it, so the caller puts the mapola of the
    same place first.

    Parameters
    ----------
    grid : MapletGrid
        In SPC coordinates.
    candidates : iterable of RegisteredMapola
        Best first. Those that cover no point still without a height are not read.
    as_means : bool
        Whether heights stay means over cells, and interpolated between them, with their blur.
        Otherwise they are corrected for the bending that noise does not explain.

    Returns
    -------
    Constraints
        Metres along the grid's Uz; sigmas are converted from the mapola's Uz [24–27].
    """
    height, sigma, coarse = (np.full(grid.shape, np.nan) for _ in range(3))
    blur = np.zeros(grid.shape)
    count = np.zeros(grid.shape, dtype=np.int32)
    areas = _Areas(grid)
    for candidate in candidates:
        unknown = ~(np.isfinite(height) | np.isfinite(coarse))
        if not overlaps(grid, candidate.grid) or not _reaches(candidate.grid, grid, unknown):
            continue
        mapola = candidate.load()
        if gives_means(mapola.grid, grid):
            new = areas.add(mapola, unknown)
            coarse[new], count[new] = areas.height[new], areas.count[new]
            continue
        at_points = at_grid_points(mapola)
        # The sigma of a mean has no part of the bending either.
        mapola = replace(mapola, sigma=at_points.sigma) if as_means else at_points
        projected = mapola if candidate.grid is grid else project_maplet(mapola, grid)
        new = projected.valid & np.isfinite(projected.sigma) & unknown
        height[new], sigma[new] = projected.height[new], projected.sigma[new]
        if as_means:
            blur[new] = _blur(mapola.grid, grid, projected.height)[new]
        row, column, _ = _nearest_cell(mapola.grid, grid, projected.height)
        count[new] = np.maximum(np.asarray(mapola.count)[row, column][new], 1)
    found = Constraints(height, sigma, count, blur=blur if as_means else None)
    return replace(found, means=areas.means(), coarse=coarse) if areas.some else found


def gives_means(surface: MapletGrid, grid: MapletGrid) -> bool:
    """Return whether a mapola or maplet has means over points of a finer grid, not heights.

    Parameters
    ----------
    surface, grid : MapletGrid
    """
    return surface.gsd > _COARSE * grid.gsd


class _Areas:
    """Collects the cells of coarser mapolas over the points of a grid."""

    def __init__(self, grid: MapletGrid) -> None:
        self._grid = grid
        self._labels = np.full(grid.shape, -1, dtype=np.int64)
        self._means: list[FloatArray] = []
        self._sigmas: list[FloatArray] = []
        self.height = np.full(grid.shape, np.nan)
        self.count = np.zeros(grid.shape, dtype=np.int32)

    @property
    def some(self) -> bool:
        """Whether there is any."""
        return bool(self._means)

    def add(self, mapola: Mapola, unknown: BoolArray) -> BoolArray:
        """Add the cells that lie wholly over `unknown` points (R, C); return the points added.

        The mean over a part of a cell is not known.
        """
        grid = self._grid
        projected = project_maplet(mapola, grid)
        row, column, inside = _nearest_cell(mapola.grid, grid, projected.height)
        inside &= unknown & mapola.valid[row, column] & np.isfinite(mapola.sigma[row, column])
        cell = row * mapola.grid.size + column
        points = np.bincount(cell[inside], minlength=mapola.grid.size**2)
        tilt = float(grid.uz @ mapola.grid.uz)
        whole = points >= _WHOLE * tilt * (mapola.grid.gsd / grid.gsd) ** 2
        new: BoolArray = inside & whole[cell]
        if not new.any():
            return new
        chosen, number = np.unique(cell[new], return_inverse=True)
        self._labels[new] = sum(len(part) for part in self._means) + number
        # A tilt of the planes cancels over a cell: its mean is the height of its middle.
        middle = grid.project(mapola.points().reshape(-1, 3)[chosen])[2]
        self._means.append(middle)
        self._sigmas.append(mapola.sigma.ravel()[chosen])
        smooth = np.isfinite(projected.height)
        self.height[new] = np.where(smooth[new], projected.height[new], middle[number])
        self.count[new] = np.maximum(np.asarray(mapola.count)[row, column][new], 1)
        return new

    def means(self) -> MeanConstraints:
        """Return the constraints."""
        sigma = np.maximum(np.concatenate(self._sigmas), _LEAST_SIGMA)
        return MeanConstraints.of_labels(self._labels, np.concatenate(self._means), sigma**-2.0)


def _reaches(other: MapletGrid, grid: MapletGrid, unknown: BoolArray) -> bool:
    """Return whether an `unknown` point of `grid` may lie over `other`, whatever its height is.

    Relief shifts a point sideways where the planes are inclined to each other; relief up to a
    quarter of the grid's width is allowed for.
    """
    if not unknown.any():
        return False
    x, y, _ = other.project(grid.points(np.zeros(grid.shape))[unknown])
    tilt = float(np.linalg.norm(np.cross(grid.uz, other.uz)))
    limit = other.half_size + 0.5 * grid.half_size * grid.gsd / other.gsd * tilt
    return bool(((np.abs(x) <= limit) & (np.abs(y) <= limit)).any())


def _blur(other: MapletGrid, grid: MapletGrid, height: FloatArray) -> FloatArray:
    """Variance (R, C), m², along each axis of what an interpolated height of `other` is a mean of.

    Of its cells, and of their weights: those at distances f and 1 − f have f (1 − f). The mean of
    both axes.
    """
    x, y, _ = other.project(grid.points(np.nan_to_num(height)))
    places = np.stack([x, y])
    between = (places - np.floor(places)) * (np.ceil(places) - places)
    return np.asarray(other.gsd**2 * (2.0 * CELL_SHARE + between.mean(axis=0)))


def _nearest_cell(
    other: MapletGrid, grid: MapletGrid, height: FloatArray
) -> tuple[IntArray, IntArray, BoolArray]:
    """Row and column (R, C) of the cell of `other` nearest to each point of `grid` at `height`.

    Third, whether the point lies in that cell: not if it is outside `other`.
    """
    x, y, _ = other.project(grid.points(np.nan_to_num(height)))
    q = other.half_size
    column = np.clip(np.rint(x), -q, q)
    row = np.clip(np.rint(y), -q, q)
    inside = (np.abs(x - column) <= 0.5) & (np.abs(y - row) <= 0.5)
    return row.astype(np.intp) + q, column.astype(np.intp) + q, inside
