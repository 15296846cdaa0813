"""The sub-cell displacement of two surfaces by Gauss–Newton, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fusion.surfacematch.displacement_kernels import (
    LEAST_POINTS,
    displaced,
    gauss_newton,
    partial_layers,
    slope_moments,
    slopes_of,
)
from fusion.surfacematch.spline import spline_coefficients
from spcola.arrays import BoolArray, FloatArray
from spcola.grids.robust_covariance import RobustCovariance, biweight_scores, robust_covariance

# Surfaces whose slopes correlate by less have no relief in common; ten thousand random slopes
# correlate by a few hundredths.
_MIN_SLOPE_CORRELATION = 0.2


@dataclass(frozen=True, eq=False)
class Fields:
    """Two surfaces on one grid, gaps filled, their common plane subtracted.

    Parameters
    ----------
    moving, fixed : (R, C) ndarray
        Metres; finite everywhere.
    moving_known, fixed_known : (R, C) bool ndarray
    moving_near : (R, C) bool ndarray
        Where the moving surface is known or a narrow gap, so that it may be interpolated.
    sigma : (R, C) ndarray
        Of their difference, relative.
    tilting : (2, R, C) ndarray
        Partials of the difference with respect to tilts along x and y: :func:`tilt_partials`.
    level : float
        Partial of the (filtered) difference with respect to a constant height.
    """

    moving: FloatArray
    moving_known: BoolArray
    moving_near: BoolArray
    fixed: FloatArray
    fixed_known: BoolArray
    sigma: FloatArray
    tilting: FloatArray
    level: float

    @property
    def moving_masks(self) -> tuple[BoolArray, BoolArray]:
        """Where the moving surface is known, and where it may be interpolated."""
        return self.moving_known, self.moving_near


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual difference of two surfaces at a displacement.

    Attributes
    ----------
    standardised : (R, C) ndarray
        Difference less a plane, over the relative sigma; NaN where nothing was compared.
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
    """The displacement that minimises the difference of two surfaces.

    Attributes
    ----------
    shift : (2,) ndarray
        x, y, cells: ``fixed(x) = moving(x − shift) + plane``.
    plane : (3,) ndarray
        Height at the middle, and rise over the grid along x and y, metres.
    covariance : (5, 5) ndarray
        Of shift (cells) and plane (metres).
    patches : float
        Approximate number of independent differences.
    residual : Residual
    iterations : int
    converged : bool
    """

    shift: FloatArray
    plane: FloatArray
    covariance: FloatArray
    patches: float
    residual: Residual
    iterations: int
    converged: bool


@lru_cache(4)
def tilts(shape: tuple[int, int]) -> FloatArray:
    """Planes (2, R, C) that rise by 1 over a grid, along x and along y, and are 0 in its middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    rising = np.stack(
        [
            (columns - (shape[1] - 1) / 2) / shape[1],
            (rows - (shape[0] - 1) / 2) / shape[0],
        ]
    )
    rising.flags.writeable = False
    return rising


def tilt_partials(height: FloatArray, gsd: float) -> FloatArray:
    """Partials of a surface's heights with respect to rotations about the middle of its grid.

    A surface that tilts by ω along x rises by ω x, and points at height z above the middle move by
    −ω z along x: heights change by ``ω (x + z ∂z/∂x)``. Without the second term the curvature of a
    round body would resist a rotation about the body's centre, which leaves a globe unchanged: on a
    maplet half a radius wide a displacement would come out a quarter too small.

    Parameters
    ----------
    height : (R, C) ndarray
        Above the grid's plane, metres; finite everywhere.
    gsd : float
        Metres.

    Returns
    -------
    (2, R, C) ndarray
        Metres, for tilts along x and along y that rise by 1 m over the grid.
    """
    rows, columns = height.shape
    extent = gsd**2 * np.array([columns, rows])[:, None, None]
    moved: FloatArray = tilts((rows, columns)) + height * np.stack(slopes_of(height)) / extent
    return moved


@dataclass(frozen=True)
class Search:
    """Options of the search for a displacement.

    Parameters
    ----------
    reach : float
        Sigma, cells, of the displacement in directions that the relief does not determine.
    max_iterations : int
    tolerance : float
        A step smaller than this, cells, means convergence.
    area : float
        Assumed correlation area of errors, cells; 0: estimated from the residual. A guess is good
        enough for the start of another search.
    """

    reach: float
    max_iterations: int
    tolerance: float = 1e-4
    area: float = 0.0


@dataclass(frozen=True, eq=False)
class Aligner:
    """Two surfaces, prepared for displacements against each other.

    Attributes
    ----------
    fields : Fields
    coefficients : (R + 4, C + 4) ndarray
        Of the cubic spline through the moving surface.
    partials : (2, R, C) ndarray
        Partials of the difference with respect to the displacement, by the slopes of the *fixed*
        surface, over sigma. ``Σ ∂m (f − m)`` changes by ``Σ ∂m ∂f`` when m is displaced. The noise
        of one surface is independent of the slopes of the other, so this is an unbiased normal
        matrix; squares of one surface's slopes would include its noise.
    """

    fields: Fields
    coefficients: FloatArray
    partials: FloatArray

    @classmethod
    def of(cls, fields: Fields) -> Aligner:
        """Compute spline coefficients and slopes."""
        partials = -np.stack(slopes_of(fields.fixed)) / fields.sigma
        return cls(fields, spline_coefficients(fields.moving), partials)

    def align(self, start: FloatArray, search: Search) -> Alignment | None:
        """Find the displacement near `start` (2,), cells, robustly (Huber, then Tukey).

        In directions in which the two surfaces have no relief in common (on a plane, along a
        ridge) the displacement is 0 ± the reach.

        Returns
        -------
        Alignment or None
            None where too few points are common.
        """
        observable = self._observable(start)
        if observable is None:
            return None
        found = self._gauss_newton(observable @ (observable.T @ start), observable, search)
        if found is None:
            return None
        near = self._linearised(found.shift, observable)
        residual = near.residual(found.plane)
        robust = self._covariance(near, residual, found.spread, search.area)
        return Alignment(
            shift=found.shift,
            plane=found.plane,
            covariance=_in_full(robust.matrix, observable, search.reach),
            patches=robust.patches,
            residual=residual,
            iterations=found.iterations,
            converged=found.converged,
        )

    def residual_at(self, shift: FloatArray, plane: FloatArray) -> Residual:
        """Residual at a displacement (2,), cells, less a plane (3,)."""
        return self._linearised(shift, np.zeros((2, 0))).residual(plane)

    def _gauss_newton(
        self, start: FloatArray, observable: FloatArray, search: Search
    ) -> _GaussNewton | None:
        """Displacement and plane by Gauss–Newton along `observable` (2, K) from `start` (2,)."""
        fields = self.fields
        shift, plane, spread, iterations, converged = gauss_newton(
            (self.coefficients, fields.fixed, fields.sigma, fields.tilting),
            (fields.moving_masks, fields.fixed_known),
            np.ascontiguousarray(observable),
            fields.level,
            np.array(start, dtype=np.float64),
            (search.max_iterations, search.tolerance),
        )
        return _GaussNewton(shift, plane, spread, iterations, converged) if iterations else None

    def _covariance(
        self, near: _Linearised, residual: Residual, spread: float, area: float
    ) -> RobustCovariance:
        """Covariance of displacements along the observable directions, and of the plane."""
        design = near.partials * near.compared
        if area > 0.0:
            rows = design.reshape(len(design), -1)
            guess = np.linalg.inv(rows @ rows.T) * area * spread**2
            return RobustCovariance(guess, np.count_nonzero(near.compared) / area)
        along = near.observable.shape[1]
        rise = design.copy()
        rise[:along] = np.tensordot(near.observable.T, self.partials * near.compared, axes=1)
        return robust_covariance(design, biweight_scores(residual.standardised, spread), rise=rise)

    def _observable(self, start: FloatArray) -> FloatArray | None:
        """Directions (2, K), K = 0 … 2, in which both surfaces have relief in common.

        The criterion is the correlation of their slopes, as noise of the surfaces is uncorrelated.
        None where too few points are common.
        """
        fields = self.fields
        moved, valid = displaced(self.coefficients, fields.moving_masks, start[0], start[1])
        compared = fields.fixed_known & valid
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
        observable: FloatArray = directions[:, shared > _MIN_SLOPE_CORRELATION * np.sqrt(own)]
        return observable

    def _linearised(self, shift: FloatArray, observable: FloatArray) -> _Linearised:
        """Linearise the difference at a displacement (2,), cells, along `observable` (2, K)."""
        fields = self.fields
        moved, valid = displaced(self.coefficients, fields.moving_masks, shift[0], shift[1])
        observable = np.ascontiguousarray(observable)
        others = (fields.fixed, fields.sigma, fields.tilting)
        partials, difference = partial_layers(moved, others, observable, fields.level)
        return _Linearised(partials, difference, fields.fixed_known & valid, moved, observable)


def _in_full(covariance: FloatArray, observable: FloatArray, reach: float) -> FloatArray:
    """Covariance (5, 5) of shift and plane from that along `observable` (2, K) and of the plane."""
    count = observable.shape[1]
    rise = np.zeros((5, count + 3))
    rise[:2, :count], rise[2:, count:] = observable, np.eye(3)
    full: FloatArray = rise @ covariance @ rise.T
    full[:2, :2] += reach**2 * (np.eye(2) - observable @ observable.T)
    return full


class _Linearised(NamedTuple):
    """Partials (K + 3, R, C) over sigma, by displacements along `observable` and by the plane.

    Also the differences (R, C) over sigma, the mask of compared points, and the moved surface.
    """

    partials: FloatArray
    difference: FloatArray
    compared: BoolArray
    moved: FloatArray
    observable: FloatArray

    def residual(self, plane: FloatArray) -> Residual:
        """Residual less a plane (3,)."""
        level = self.difference - np.tensordot(plane, self.partials[-3:], axes=1)
        return Residual(np.where(self.compared, level, np.nan), self.moved)


class _GaussNewton(NamedTuple):
    """Result of Gauss–Newton, with the robust standard deviation of the residual."""

    shift: FloatArray
    plane: FloatArray
    spread: float
    iterations: int
    converged: bool
