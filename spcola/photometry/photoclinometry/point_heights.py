"""Heights of single points between those of a grid, with errors that groups of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.linalg import block_diag

from spcola.arrays import BoolArray, FloatArray, IntArray, check_finite, check_shape, read_only
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.photometry.photoclinometry.surface import Surface

# Upper triangle of (∂h/∂x, ∂h/∂y, h), row by row.
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class PointHeights:
    """Heights of N points, each with an error of its own and one that its group shares.

    Parameters
    ----------
    places : (N, 3) ndarray
        x and y from the centre of the grid along Ux and Uy, and height along Uz, metres.
    sigma : (N,) ndarray
        Of each point alone, metres.
    group : (N,) integer ndarray
        To which of G groups each belongs.
    covariance : (G, G) ndarray
        Of the errors that the groups share, m².

    Raises
    ------
    InvalidValueError
        If lengths differ, a place is not finite, a sigma not positive, a point belongs to a group
        that is not there, or the covariance is not positive definite.
    """

    places: FloatArray
    sigma: FloatArray
    group: IntArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        count, groups = len(self.places), len(self.covariance)
        check_shape(self.places, (count, 3), "places")
        check_shape(self.sigma, (count,), "sigmas of points")
        check_shape(self.group, (count,), "groups of points")
        check_shape(self.covariance, (groups, groups), "covariance of groups")
        check_finite(self.places, "places")
        if not ((self.sigma > 0.0) & np.isfinite(self.sigma)).all():
            raise InvalidValueError("must be positive and finite", "sigmas of points")
        if count and not 0 <= self.group.min() <= self.group.max() < groups:
            raise InvalidValueError("names a group that is not there", "groups of points")
        positive = np.isfinite(self.covariance).all() and np.all(
            np.linalg.eigvalsh(self.covariance) > 0.0
        )
        if not positive:
            raise InvalidValueError("is not positive definite", "covariance of groups")
        for name in ("places", "sigma", "group", "covariance"):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name))))

    def __len__(self) -> int:
        return len(self.places)

    def subset(self, kept: BoolArray) -> PointHeights:
        """Return the points of a mask (N,); groups stay."""
        return replace(
            self, places=self.places[kept], sigma=self.sigma[kept], group=self.group[kept]
        )


@dataclass(frozen=True, eq=False)
class CellHeights:
    """Normal equations of points in the cells of a grid; a cell is a plane, as for its light.

    Attributes
    ----------
    normal : (6, R − 1, C − 1) ndarray
        Upper triangle of the information of (∂h/∂x, ∂h/∂y, h).
    coupled : (G, R, C) ndarray
        Products of the heights of the points of the grid with the errors that groups share.
    shared : (G, G) ndarray
        Information on these errors, prior included.
    places : (N, 3) ndarray
        Of the points in cells of the grid: x, y and height, metres.
    weight : (N,) ndarray
        Of each alone, 1/m².
    group : (N,) integer ndarray
        To which of the G groups each belongs.
    cell : (N,) integer ndarray
        Number of the cell of each, row by row.
    partials : (3, N) ndarray
        Derivatives of the height of each by ∂h/∂x, ∂h/∂y and h of its cell.
    """

    normal: FloatArray
    coupled: FloatArray
    shared: FloatArray
    places: FloatArray
    weight: FloatArray
    group: IntArray
    cell: IntArray
    partials: FloatArray

    @classmethod
    def of(cls, points: Sequence[PointHeights], level: MapletGrid) -> Self:
        """Sum points in the cells of a grid of the same place; those outside do not count."""
        prior = [0.5 * (one + one.T) for one in (np.linalg.inv(p.covariance) for p in points)]
        first = np.cumsum([0, *(len(one) for one in prior)])
        places = np.concatenate([np.zeros((0, 3)), *(one.places for one in points)])
        weight = np.concatenate([np.zeros(0), *(one.sigma for one in points)]) ** -2.0
        groups = [one.group + start for one, start in zip(points, first, strict=False)]
        group = np.concatenate([np.zeros(0, dtype=np.int64), *groups])
        column, row, away_x, away_y = _in_cells(places, level)
        cells = level.size - 1
        inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
        places, weight, group = places[inside], weight[inside], group[inside]
        cell = (row * cells + column)[inside]
        partials = np.stack([away_x[inside], away_y[inside], np.ones(len(cell))])
        shared = block_diag(*prior) if prior else np.zeros((0, 0))
        coupled = np.zeros((len(shared), *level.shape))
        for number in np.unique(group):
            own = np.where(group == number, weight, 0.0)
            coupled[number] = _to_points(_summed(cell, own * partials, cells), level.gsd)
        return cls(
            _summed(cell, [weight * partials[a] * partials[b] for a, b in _PAIRS], cells),
            coupled,
            shared + np.diag(np.bincount(group, weight, len(shared))),
            places, weight, group, cell, partials,
        )  # fmt: skip

    def about(self, surface: Surface) -> tuple[FloatArray, FloatArray]:
        """Return right-hand sides of changes of a surface (3, R − 1, C − 1), and of groups (G,).

        Heights of the surface between its points are those of a spline: planes of cells lie above
        hollows and below tops. Derivatives are those of the planes, so that only cells are coupled;
        the rounds lead to the spline all the same.
        """
        x, y, height = self.places.T
        pull = self.weight * (height - surface.height_at(x, y))
        right = _summed(self.cell, pull * self.partials, self.normal.shape[1])
        return right, np.bincount(self.group, pull, len(self.shared)).astype(np.float64)


def _summed(cell: IntArray, values: Sequence[FloatArray] | FloatArray, cells: int) -> FloatArray:
    """Return the sums (K, R − 1, C − 1) of K values of points (K, N) in their cells."""
    sums = [np.bincount(cell, one, cells * cells).reshape(cells, cells) for one in values]
    return np.array(sums, dtype=np.float64)


def _to_points(products: FloatArray, gsd: float) -> FloatArray:
    """Return products (R, C) with heights of points, of those with slopes and means of cells."""
    slope_x, slope_y, mean = products
    points = np.zeros((mean.shape[0] + 1, mean.shape[1] + 1))
    for row, sign_y in ((slice(None, -1), -1.0), (slice(1, None), 1.0)):
        for column, sign_x in ((slice(None, -1), -1.0), (slice(1, None), 1.0)):
            points[row, column] += (sign_x * slope_x + sign_y * slope_y) / (2.0 * gsd) + mean / 4.0
    return points


def _in_cells(
    places: FloatArray, level: MapletGrid
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return column and row (N,) of the cell of each place, and how far its middle is, metres."""
    x, y = places[:, :2].T / level.gsd + level.half_size
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    return column, row, (x - column - 0.5) * level.gsd, (y - row - 0.5) * level.gsd
