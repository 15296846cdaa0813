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
class PointEquations:
    """Normal equations of the heights (R, C) of a grid, from N points in its cells.

    The height of a point changes with those of the four corners of its cell, bilinearly.

    Attributes
    ----------
    diagonals : (5, R, C) ndarray
        Normal matrix, as of :class:`CellSurface`.
    coupled : (G, R, C) ndarray
        Products of the heights of the grid with the errors that groups share.
    shared : (G, G) ndarray
        Information on these errors, prior included.
    places : (N, 3) ndarray
        x, y and height of each point, metres.
    weight : (N,) ndarray
        Of each alone, 1/m².
    group : (N,) integer ndarray
        To which of the G groups each belongs.
    corner : (N,) integer ndarray
        Number of the first corner of the cell of each, row by row.
    shares : (4, N) ndarray
        Derivatives of the height of each by those of its corners: the first, the next, below the
        first, below the next.
    """

    diagonals: FloatArray
    coupled: FloatArray
    shared: FloatArray
    places: FloatArray
    weight: FloatArray
    group: IntArray
    corner: IntArray
    shares: FloatArray

    @classmethod
    def of(cls, points: Sequence[PointHeights], level: MapletGrid) -> Self:
        """Sum points over the corners of their cells; those outside the grid do not count."""
        prior = [np.linalg.inv(one.covariance) for one in points]
        shared = block_diag(*(0.5 * (one + one.T) for one in prior)) if prior else np.zeros((0, 0))
        first = np.cumsum([0, *(len(one) for one in prior)])
        groups = [one.group + start for one, start in zip(points, first, strict=False)]
        places = np.concatenate([np.zeros((0, 3)), *(one.places for one in points)])
        weight = np.concatenate([np.zeros(0), *(one.sigma for one in points)]) ** -2.0
        group = np.concatenate([np.zeros(0, dtype=np.int64), *groups])
        x, y = places[:, :2].T / level.gsd + level.half_size
        inside = (x >= 0) & (x < level.size - 1) & (y >= 0) & (y < level.size - 1)
        x, y, places, weight, group = (one[inside] for one in (x, y, places, weight, group))
        column, row = x.astype(np.int64), y.astype(np.int64)
        over, down = x - column, y - row
        corner = row * level.size + column
        shares = np.stack(
            [(1 - over) * (1 - down), over * (1 - down), (1 - over) * down, over * down]
        )
        coupled = np.zeros((len(shared), *level.shape))
        for number in np.unique(group):
            coupled[number] = _to_corners(corner, shares * (weight * (group == number)), level)
        return cls(
            _products(corner, shares, weight, level),
            coupled,
            shared + np.diag(np.bincount(group, weight, len(shared))),
            places, weight, group, corner, shares,
        )  # fmt: skip

    @property
    def occupied(self) -> BoolArray:
        """Cells (R − 1, C − 1) with points."""
        rows, columns = self.diagonals.shape[1:]
        count = np.bincount(self.corner, minlength=rows * columns).reshape(rows, columns)
        return np.asarray(count[:-1, :-1] > 0)

    def about(self, surface: Surface) -> tuple[FloatArray, FloatArray]:
        """Return right-hand sides of changes of a surface (R, C), and of groups (G,).

        Between its points the surface is a cubic spline: planes and saddles between four corners
        lie above hollows and below tops. What the bilinear derivatives miss of a change is less
        than the change, so that the rounds have it.
        """
        x, y, height = self.places.T
        pull = self.weight * (height - surface.height_at(x, y))
        right = _to_corners(self.corner, self.shares * pull, surface.grid)
        return right, np.bincount(self.group, pull, len(self.shared)).astype(np.float64)


def _to_corners(corner: IntArray, values: FloatArray, level: MapletGrid) -> FloatArray:
    """Return the sums (R, C) of values (4, N) at the corners of cells of N points."""
    sums = np.zeros(level.size**2)
    for value, apart in zip(values, (0, 1, level.size, level.size + 1), strict=True):
        sums += np.bincount(corner + apart, value, level.size**2)
    return sums.reshape(level.shape)


def _products(
    corner: IntArray, shares: FloatArray, weight: FloatArray, level: MapletGrid
) -> FloatArray:
    """Return the normal matrix (5, R, C) of N points, with corners in the order of `shares`."""
    first, second, below, last = shares
    size = level.size

    def summed(products: FloatArray, apart: int = 0) -> FloatArray:
        sums = np.bincount(corner + apart, weight * products, size**2)
        return sums.reshape(level.shape).astype(np.float64)

    return np.stack(
        [
            _to_corners(corner, weight * shares**2, level),
            summed(first * second) + summed(below * last, size),
            summed(second * below, 1),
            summed(first * below) + summed(second * last, 1),
            summed(first * last),
        ]
    )
