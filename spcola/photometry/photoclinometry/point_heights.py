"""Heights of single points between those of a grid, with errors that groups of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from spcola.arrays import BoolArray, FloatArray, IntArray, check_finite, check_shape, read_only
from spcola.errors import InvalidValueError
from spcola.grids import MapletGrid
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.surface import Surface

# Upper triangle of (∂h/∂x, ∂h/∂y, h), row by row.
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_MATRIX = ((0, 1, 2), (1, 3, 4), (2, 4, 5))


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
    right : (3, R − 1, C − 1) ndarray
        Products with the heights.
    coupled : (G, R, C) ndarray
        Products of the heights of the points of the grid with the errors that groups share.
    shared : (G, G) ndarray
        Information on these errors, prior included.
    shared_right : (G,) ndarray
    """

    normal: FloatArray
    right: FloatArray
    coupled: FloatArray
    shared: FloatArray
    shared_right: FloatArray

    @classmethod
    def of(cls, points: Sequence[PointHeights], level: MapletGrid) -> Self:
        """Sum points in the cells of a grid of the same place; those outside do not count."""
        parts = [_one(some, level) for some in points]
        cells = (level.size - 1,) * 2
        size = sum(len(part.shared) for part in parts)
        shared, first = np.zeros((size, size)), 0
        for part in parts:
            last = first + len(part.shared)
            shared[first:last, first:last] = part.shared
            first = last
        return cls(
            np.sum([np.zeros((6, *cells)), *(part.normal for part in parts)], axis=0),
            np.sum([np.zeros((3, *cells)), *(part.right for part in parts)], axis=0),
            np.concatenate([np.zeros((0, *level.shape)), *(part.coupled for part in parts)]),
            shared,
            np.concatenate([np.zeros(0), *(part.shared_right for part in parts)]),
        )

    def about(self, surface: Surface) -> tuple[FloatArray, FloatArray]:
        """Return right-hand sides of changes of a surface (3, R − 1, C − 1), and of groups (G,)."""
        now = np.stack([*surface.slopes, at_cells(surface.height)])
        right = np.stack(
            [
                self.right[a] - sum(self.normal[_MATRIX[a][b]] * now[b] for b in range(3))
                for a in range(3)
            ]
        )
        return right, self.shared_right - np.tensordot(self.coupled, surface.height, 2)


def _one(points: PointHeights, level: MapletGrid) -> CellHeights:
    """Return the sums of some points with groups of their own."""
    cells, groups = level.size - 1, len(points.covariance)
    column, row, away_x, away_y = _in_cells(points.places, level)
    inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
    place, group = (row * cells + column)[inside], points.group[inside]
    weight, height = points.sigma[inside] ** -2.0, points.places[inside, 2]
    partials = np.stack([away_x[inside], away_y[inside], np.ones(len(place))])

    def summed(values: FloatArray) -> FloatArray:
        total = np.bincount(place, values, cells * cells)
        return total.astype(np.float64).reshape(cells, cells)

    coupled = np.zeros((groups, *level.shape))
    for number in np.unique(group):
        own = np.where(group == number, weight, 0.0)
        coupled[number] = _to_points([summed(own * one) for one in partials], level.gsd)
    prior = np.linalg.inv(points.covariance)
    return CellHeights(
        np.stack([summed(weight * partials[a] * partials[b]) for a, b in _PAIRS]),
        np.stack([summed(weight * one * height) for one in partials]),
        coupled,
        0.5 * (prior + prior.T) + np.diag(np.bincount(group, weight, groups)),
        np.bincount(group, weight * height, groups).astype(np.float64),
    )


def _to_points(products: Sequence[FloatArray], gsd: float) -> FloatArray:
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
