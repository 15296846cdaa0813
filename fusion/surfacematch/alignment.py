"""The sub-cell displacement of two surfaces by Gauss–Newton, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fusion.surfacematch.displacing import (
    LEAST_POINTS,
    displaced,
    gauss_newton,
    partial_layers,
    slope_moments,
    slopes_of,
    spline_of,
)
from spcola.arrays import BoolArray, FloatArray
from spcola.grids.statistics import RobustCovariance, robust_covariance
from spcola.math.robust import biweight_scores

# Slopes that correlate by less have no relief in common: chance makes a few hundredths of ten
# thousand of them.
_TOLD = 0.2


@dataclass(frozen=True, eq=False)
class Fields:
    """Two surfaces on one grid, gaps filled, their common plane taken out.

    Parameters
    ----------
    moving, fixed : (R, C) ndarray
        Metres; finite everywhere.
    moving_known, fixed_known : (R, C) bool ndarray
    moving_near : (R, C) bool ndarray
        Where the moving surface is known or closed from around, so that values between points may
        rest on it.
    sigma : (R, C) ndarray
        Of their difference, relative.
    tipping : (2, R, C) ndarray
        What a tilt that rises by 1 m over the grid does to the difference, along x and along y:
        :func:`tipping`.
    level : float
        What a filter made of a difference of 1 m that is alike everywhere.
    """

    moving: FloatArray
    moving_known: BoolArray
    moving_near: BoolArray
    fixed: FloatArray
    fixed_known: BoolArray
    sigma: FloatArray
    tipping: FloatArray
    level: float

    @property
    def moving_masks(self) -> tuple[BoolArray, BoolArray]:
        """Where the moving surface is known, and where it may be interpolated."""
        return self.moving_known, self.moving_near


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of the difference of two surfaces at a displacement.

    Attributes
    ----------
    standardised : (R, C) ndarray
        Less a plane, over the relative sigma; NaN where nothing was compared.
    moved : (R, C) ndarray
        The moving surface, displaced, metres.
    """

    standardised: FloatArray
    moved: FloatArray

    @property
    def compared(self) -> BoolArray:
        """Mask (R, C) of the points that were compared."""
        return np.isfinite(self.standardised)


@dataclass(frozen=True, eq=False)
class Alignment:
    """The displacement that makes the difference of two surfaces smallest.

    Attributes
    ----------
    shift : (2,) ndarray
        x, y, cells: ``fixed(x) = moving(x − shift) + plane``.
    plane : (3,) ndarray
        Height at the middle, and rise over the grid along x and y, metres.
    covariance : (5, 5) ndarray
        Of shift (cells) and plane (metres).
    patches : float
        Of the differences, about independent.
    left : Left
    iterations : int
    settled : bool
    """

    shift: FloatArray
    plane: FloatArray
    covariance: FloatArray
    patches: float
    left: Left
    iterations: int
    settled: bool


@lru_cache(4)
def tilts(shape: tuple[int, int]) -> FloatArray:
    """Planes (2, R, C) that rise by 1 over a grid along x and along y, 0 in its middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    rising = np.stack(
        [
            (columns - (shape[1] - 1) / 2) / shape[1],
            (rows - (shape[0] - 1) / 2) / shape[0],
        ]
    )
    rising.flags.writeable = False
    return rising


def tipping(height: FloatArray, gsd: float) -> FloatArray:
    """What rotations about the middle of a grid do to a surface's heights, to first order.

    A surface that tilts by ω along x rises by ω x, and what lies at height z above the middle moves
    by −ω z along x: heights change by ``ω (x + z ∂z/∂x)``. Without the second term the shape of a
    round body would speak against any rotation about the body's centre, which leaves a globe as it
    is: on a maplet that is half a radius wide a displacement would come out a quarter too small.

    Parameters
    ----------
    height : (R, C) ndarray
        Above the grid's plane, metres; finite everywhere.
    gsd : float
        Metres.

    Returns
    -------
    (2, R, C) ndarray
        Metres, of tilts along x and along y that rise by 1 m over the grid.
    """
    rows, columns = height.shape
    extent = gsd**2 * np.array([columns, rows])[:, None, None]
    moved: FloatArray = tilts((rows, columns)) + height * np.stack(slopes_of(height)) / extent
    return moved


@dataclass(frozen=True)
class Search:
    """How a displacement is looked for.

    Parameters
    ----------
    reach : float
        Cells: the sigma of a displacement that the relief does not tell.
    max_iterations : int
    tolerance : float
        One that moves by less, cells, has settled.
    area : float
        Cells over which errors hold together; 0: as the residual shows. For a start of another
        search a guess will do.
    """

    reach: float
    max_iterations: int
    tolerance: float = 1e-4
    area: float = 0.0


@dataclass(frozen=True, eq=False)
class Aligner:
    """Two surfaces, made ready to be displaced against each other.

    Attributes
    ----------
    fields : Fields
    coefficients : (R + 4, C + 4) ndarray
        Of the cubic spline through the moving surface.
    partials : (2, R, C) ndarray
        What a displacement does to the difference, by the slopes of the *fixed* surface, over
        sigma. As ``Σ ∂m (f − m)`` changes by ``Σ ∂m ∂f`` when m is displaced, and as the noise of
        one surface has nothing to do with the slopes of the other, this is what the data know;
        squares of one surface's slopes hold its noise.
    """

    fields: Fields
    coefficients: FloatArray
    partials: FloatArray

    @classmethod
    def of(cls, fields: Fields) -> Aligner:
        """Fit the spline, take the slopes."""
        partials = -np.stack(slopes_of(fields.fixed)) / fields.sigma
        return cls(fields, spline_of(fields.moving), partials)

    def align(self, start: FloatArray, search: Search) -> Alignment | None:
        """Find the displacement near `start` (2,), cells, robustly (Huber, then Tukey).

        Along a direction in which the two surfaces have no relief in common, on a plane or along a
        ridge, nothing is looked for: the displacement is 0 there, ± the reach.

        Returns
        -------
        Alignment or None
            None where too few points are common.
        """
        told = self._told(start)
        if told is None:
            return None
        found = self._settled(told @ (told.T @ start), told, search)
        if found is None:
            return None
        near = self._linearised(found.shift, told)
        left = near.left(found.plane)
        known = self._covariance(near, left, found.spread, search.area)
        return Alignment(
            shift=found.shift,
            plane=found.plane,
            covariance=_in_full(known.matrix, told, search.reach),
            patches=known.patches,
            left=left,
            iterations=found.iterations,
            settled=found.settled,
        )

    def left_at(self, shift: FloatArray, plane: FloatArray) -> Left:
        """What is left of the difference at a displacement (2,), cells, beside a plane (3,)."""
        return self._linearised(shift, np.zeros((2, 0))).left(plane)

    def _settled(self, start: FloatArray, told: FloatArray, search: Search) -> _Settled | None:
        """Gauss–Newton along `told` (2, K) from a displacement (2,), and the plane there."""
        fields = self.fields
        shift, plane, spread, iterations, settled = gauss_newton(
            (self.coefficients, fields.fixed, fields.sigma, fields.tipping),
            (fields.moving_masks, fields.fixed_known),
            np.ascontiguousarray(told),
            fields.level,
            np.array(start, dtype=np.float64),
            (search.max_iterations, search.tolerance),
        )
        return _Settled(shift, plane, spread, iterations, settled) if iterations else None

    def _covariance(
        self, near: _Linearised, left: Left, spread: float, area: float
    ) -> RobustCovariance:
        """Of displacements along the directions that are told, and of the plane."""
        design = near.partials * near.compared
        if area > 0.0:
            rows = design.reshape(len(design), -1)
            guess = np.linalg.inv(rows @ rows.T) * area * spread**2
            return RobustCovariance(guess, np.count_nonzero(near.compared) / area)
        along = near.told.shape[1]
        rise = design.copy()
        rise[:along] = np.tensordot(near.told.T, self.partials * near.compared, axes=1)
        return robust_covariance(design, biweight_scores(left.standardised, spread), rise=rise)

    def _told(self, start: FloatArray) -> FloatArray | None:
        """Directions (2, K), K = 0 … 2, in which both surfaces have relief in common.

        The correlation of their slopes tells: slopes that are noise are each surface's own. None
        where too few points are common.
        """
        fields = self.fields
        moved, held = displaced(self.coefficients, fields.moving_masks, start[0], start[1])
        compared = fields.fixed_known & held
        if np.count_nonzero(compared) < LEAST_POINTS:
            return None
        moments = slope_moments(moved, self.partials, fields.sigma, compared)
        common = moments[:2, 2:]
        _, directions = np.linalg.eigh(common + common.T)
        shared, one, two = (
            np.sum(directions * (matrix @ directions), axis=0)
            for matrix in (common, moments[:2, :2], moments[2:, 2:])
        )
        own = one * two
        told: FloatArray = directions[:, shared > _TOLD * np.sqrt(own)]
        return told

    def _linearised(self, shift: FloatArray, told: FloatArray) -> _Linearised:
        """Of the difference at a displacement (2,), cells, with respect to those along `told`."""
        fields = self.fields
        moved, held = displaced(self.coefficients, fields.moving_masks, shift[0], shift[1])
        told = np.ascontiguousarray(told)
        others = (fields.fixed, fields.sigma, fields.tipping)
        partials, difference = partial_layers(moved, others, told, fields.level)
        return _Linearised(partials, difference, fields.fixed_known & held, moved, told)


def _in_full(covariance: FloatArray, told: FloatArray, reach: float) -> FloatArray:
    """Covariance (5, 5) of shift and plane from that of the directions `told` (2, K) and plane."""
    count = told.shape[1]
    rise = np.zeros((5, count + 3))
    rise[:2, :count], rise[2:, count:] = told, np.eye(3)
    full: FloatArray = rise @ covariance @ rise.T
    full[:2, :2] += reach**2 * (np.eye(2) - told @ told.T)
    return full


class _Linearised(NamedTuple):
    """Partials (K + 3, R, C) by displacements along `told` (2, K) and by the plane, over sigma.

    With them the differences (R, C) over sigma, where they may be compared, and the moved surface.
    """

    partials: FloatArray
    difference: FloatArray
    compared: BoolArray
    moved: FloatArray
    told: FloatArray

    def left(self, plane: FloatArray) -> Left:
        """What is left beside a plane (3,)."""
        level = self.difference - np.tensordot(plane, self.partials[-3:], axes=1)
        return Left(np.where(self.compared, level, np.nan), self.moved)


class _Settled(NamedTuple):
    """Where Gauss–Newton ended, and the robust standard deviation of what is left there."""

    shift: FloatArray
    plane: FloatArray
    spread: float
    iterations: int
    settled: bool
