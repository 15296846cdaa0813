"""Heights that constrain the integration of slopes inside photoclinometry [23]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray, IntArray, check_shape, frozen
from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.grids.bending import blurred
from spcola.grids.gaps import filled
from spcola.math.robust import MAD_TO_SIGMA, mad
from spcola.photometry.photoclinometry.point_heights import PointEquations, PointHeights

# Fewest points that share cells for a spread of them.
_FEWEST = 20


@dataclass(frozen=True)
class ConstraintFit:
    """How constraining heights fit the surface.

    Parameters
    ----------
    name : str
        Of the constraint.
    heights : int
        Number of heights that constrain.
    left_out : int
        Number of heights that were left out as false.
    residual_m : float
        Robust root mean square of these heights less those of the surface, metres: 1.4826 times the
        median of absolute values. NaN without any.
    ratio : float
        The same of each over its sigma, in which relief is that the grid does not resolve: much
        more than 1 where they contradict the surface.
    """

    name: str
    heights: int
    left_out: int
    residual_m: float
    ratio: float


@dataclass(frozen=True, eq=False)
class HeightConstraint:
    """Heights of points of a grid.

    Parameters
    ----------
    name : str
        Where they come from: the shape, overlapping maplets, another instrument.
    height : (R, C) ndarray
        Metres along Uz; NaN where there is none.
    weight : (R, C) ndarray
        1/σ², 1/m²; of heights with common errors, σ² times the number of points that share one.
    points : PointHeights, optional
        Heights between those of the grid, which constrain in their place: `height` and `weight`
        are then what is known of their surroundings.
    common : float
        Number of neighbouring points that share one error; 1 or more.
    left_out : int
        Number of heights that were left out as false, before.
    shared_sigma : float
        Standard deviation of an error that all heights of the grid share, metres.
    blur : (R, C) ndarray, optional
        Variance along each axis of what each height is a mean over, m²: a²/12 of a square of side
        a. Without it they are heights at the points.
    least_sigma : float
        If positive, the sigma of the heights is not known, and `weight` is that of the largest
        which is possible: before the finest level it becomes the one that images show
        (:meth:`as_seen`), and this, metres, at least.

    Raises
    ------
    InvalidValueError
        If shapes differ, a weight, a sigma or a blur is negative or not finite, less than one point
        shares an error, or points have a least sigma.
    """

    name: str
    height: FloatArray
    weight: FloatArray
    points: PointHeights | None = None
    common: float = 1.0
    left_out: int = 0
    shared_sigma: float = 0.0
    blur: FloatArray | None = None
    least_sigma: float = 0.0

    def __post_init__(self) -> None:
        height = frozen(self.height, (None, None), f"heights of {self.name}")
        weight = frozen(self.weight, (None, None), f"weights of {self.name}")
        check_shape(weight, height.shape, f"weights of {self.name}")
        if np.isinf(height).any() or not ((weight >= 0) & (weight < np.inf)).all():
            raise InvalidValueError("contains an infinite height or a wrong weight", self.name)
        for name in ("shared_sigma", "least_sigma"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise InvalidValueError(f"has a wrong {name.replace('_', ' ')}", self.name)
        if not 1.0 <= self.common < np.inf:
            raise InvalidValueError(
                f"has errors that {self.common:g} points share, not 1 or more", self.name
            )
        if self.least_sigma and self.points is not None:
            raise InvalidValueError("has points, whose sigmas must be known", self.name)
        if self.blur is not None:
            blur = frozen(self.blur, height.shape, f"blur of {self.name}")
            if not ((blur >= 0.0) & (blur < np.inf)).all():
                raise InvalidValueError("has a wrong blur", self.name)
            object.__setattr__(self, "blur", blur)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "weight", weight)

    @classmethod
    def of_sigma(
        cls, name: str, height: FloatArray, sigma: FloatArray | float, *, common: float = 1.0
    ) -> HeightConstraint:
        """Return heights of a sigma, metres, of which `common` neighbouring points share one error.

        Parameters
        ----------
        name : str
        height : (R, C) ndarray
            Metres; NaN where unknown.
        sigma : float or (R, C) ndarray
            Metres; NaN where unknown.
        common : float
        """
        with np.errstate(divide="ignore"):
            weight = 1.0 / (np.broadcast_to(sigma, height.shape) ** 2 * common)
        known = np.isfinite(height) & np.isfinite(weight)
        heights, weights = np.where(known, height, np.nan), np.where(known, weight, 0.0)
        return cls(name, heights, weights, common=common)

    @classmethod
    def of_points(
        cls,
        name: str,
        grid: MapletGrid,
        places: FloatArray,
        sigma: FloatArray,
        group: IntArray,
        covariance: FloatArray,
    ) -> HeightConstraint:
        """Return heights of N points between those of a grid, in G groups with common errors.

        Parameters
        ----------
        name : str
        grid : MapletGrid
        places : (N, 3) ndarray
            x and y from the centre of the grid along Ux and Uy, and height along Uz, metres.
        sigma : (N,) ndarray
            Of each point alone, metres.
        group : (N,) integer ndarray
        covariance : (G, G) ndarray
            Of the errors that groups share, m².

        Raises
        ------
        InvalidValueError
            If lengths differ, a place is not finite, a sigma not positive, a group is not there, or
            the covariance is not positive definite.
        """
        points = PointHeights(places, sigma, group, covariance)
        x, y = np.rint(points.places[:, :2].T / grid.gsd).astype(np.int64) + grid.half_size
        inside = (x >= 0) & (x < grid.size) & (y >= 0) & (y < grid.size)
        place, weight = (y * grid.size + x)[inside], points.sigma[inside] ** -2.0
        total = np.bincount(place, weight, grid.size**2).astype(np.float64)
        pull = np.bincount(place, weight * points.places[inside, 2], grid.size**2)
        mean = np.divide(pull, total, out=np.full(grid.size**2, np.nan), where=total > 0)
        # No number of points determines a height better than the error that they share.
        shared = np.full(grid.size**2, np.inf)
        np.minimum.at(shared, place, np.diag(points.covariance)[points.group[inside]])
        known = np.where(total > 0, total / (1.0 + total * np.where(total > 0, shared, 0.0)), 0.0)
        return cls(name, mean.reshape(grid.shape), known.reshape(grid.shape), points)

    @property
    def shows_cells(self) -> bool:
        """Whether each height has an error of its own, so that relief of single cells shows."""
        return self.common == 1.0

    def subset(self, fraction: float, generator: np.random.Generator) -> HeightConstraint:
        """Return a random share of the heights, each with its whole weight.

        Parameters
        ----------
        fraction : float
            0 … 1.
        generator : numpy Generator
        """
        kept = generator.random(self.weight.shape) < fraction
        chosen = replace(self, weight=np.where(kept, self.weight, 0.0))
        if self.points is None:
            return chosen
        return replace(
            chosen, points=self.points.subset(generator.random(len(self.points)) < fraction)
        )

    def as_seen(self, away: FloatArray) -> HeightConstraint:
        """Return the same with the sigma that its distances from known heights show.

        It is between `least_sigma` and that of the weights.

        Parameters
        ----------
        away : (N,) ndarray
            How far its heights lie above those that images determine, metres.
        """
        known = self.weight > 0.0
        assumed = float(np.median(self.weight[known] * self.common)) ** -0.5
        seen = max(float(np.sqrt(np.mean(away**2))), self.least_sigma)
        return replace(self, weight=self.weight * max(assumed / seen, 1.0) ** 2)

    def fit(self, maplet: Maplet) -> ConstraintFit:
        """Return how far its heights lie from those of a maplet on its grid.

        Parameters
        ----------
        maplet : Maplet
        """
        if self.points is None:
            blur = None if self.blur is None else self.blur / maplet.grid.gsd**2
            seen = np.where(maplet.valid, blurred(filled(maplet.height), blur), np.nan)
            apart = (self.height - seen)[self.weight > 0.0]
            own = 1.0 / (self.weight * self.common)[self.weight > 0.0]
            sigma = np.sqrt(own + self.shared_sigma**2)
        else:
            x, y = self.points.places[:, :2].T / maplet.grid.gsd
            apart = self.points.places[:, 2] - maplet.grid.interpolated(maplet.height, x, y)
            shared = np.diag(self.points.covariance)[self.points.group]
            own = np.maximum(self.points.sigma, _spread_in_cells(x, y, apart))
            sigma = np.sqrt(own**2 + shared)
        known = np.isfinite(apart)
        residual, ratio = np.nan, np.nan
        if known.any():
            residual, ratio = (
                float(np.median(np.abs(values[known]))) * MAD_TO_SIGMA
                for values in (apart, apart / sigma)
            )
        return ConstraintFit(self.name, len(apart), self.left_out, residual, ratio)


def _spread_in_cells(x: FloatArray, y: FloatArray, apart: FloatArray) -> float:
    """Return the standard deviation, metres, of residuals (N,) of points that share a cell.

    It is their noise, and relief that the grid does not resolve. 0 with too few of them.
    """
    known = np.isfinite(apart)
    places = np.stack([np.floor(x[known]), np.floor(y[known])])
    _, cell, count = np.unique(places, axis=1, return_inverse=True, return_counts=True)
    cell, several = cell.ravel(), count > 1
    if count[several].sum() < _FEWEST:
        return 0.0
    mean = np.bincount(cell, apart[known]) / count
    free = np.sqrt(count / np.maximum(count - 1.0, 1.0))
    return float(mad(((apart[known] - mean[cell]) * free[cell])[several[cell]]))


@dataclass(frozen=True, eq=False)
class GridHeights:
    """Constraining heights of the points of a grid.

    Attributes
    ----------
    height, weight : (R, C) ndarrays
        Metres, 0 without any, and 1/m².
    shared_sigma : float
        Standard deviation of an error that all of them share, metres.
    blur : (R, C) ndarray, optional
        As of :class:`HeightConstraint`, squared grid steps.
    """

    height: FloatArray
    weight: FloatArray
    shared_sigma: float = 0.0
    blur: FloatArray | None = None

    @classmethod
    def of(
        cls, constraints: Sequence[HeightConstraint], grid: MapletGrid, level: MapletGrid
    ) -> GridHeights:
        """Return weighted means, and sums of weights, of heights on `grid` at points of a `level`.

        Each point of the grid counts at the nearest point of the coarser level.
        """
        index = np.rint(grid.offsets * grid.gsd / level.gsd).astype(np.int64) + level.half_size
        place = (index[:, None] * level.size + index[None, :]).ravel()
        weight, pull, spread = np.zeros((3, level.size**2))
        for one in constraints:
            known = one.weight.ravel()
            weight += np.bincount(place, known, level.size**2)
            pull += np.bincount(place, known * np.nan_to_num(one.height).ravel(), level.size**2)
            if one.blur is not None:
                spread += np.bincount(place, known * one.blur.ravel(), level.size**2)
        share = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0)
        mean, blur = ((share * total).reshape(level.shape) for total in (pull, spread))
        shared = max((one.shared_sigma for one in constraints), default=0.0)
        steps = blur / level.gsd**2 if blur.any() else None
        return cls(mean, weight.reshape(level.shape), shared, steps)

    def above(self, height: FloatArray) -> FloatArray:
        """Return how far the heights lie above a surface (R, C), metres."""
        return self.height - blurred(height, self.blur)


def gathered(
    constraints: tuple[HeightConstraint, ...], grid: MapletGrid, level: MapletGrid
) -> tuple[tuple[GridHeights, ...], PointEquations]:
    """Return the heights at the points of a level, and those of single points between them.

    The first are all whose errors are not shared; each of the further ones shares an error.
    """
    for one in constraints:
        check_shape(one.height, grid.shape, f"heights of {one.name}")
    gridded = [one for one in constraints if one.points is None]
    alone = [one for one in gridded if not one.shared_sigma]
    sharing = [[one] for one in gridded if one.shared_sigma]
    heights = tuple(GridHeights.of(some, grid, level) for some in (alone, *sharing))
    points = PointEquations.of([one.points for one in constraints if one.points is not None], level)
    return heights, points


def constrained_points(
    constraints: tuple[HeightConstraint, ...], grid: MapletGrid, reach: float
) -> BoolArray:
    """Return the points (R, C) within `reach` cells of heights that are known to a GSD."""
    weight = np.sum([np.zeros(grid.shape), *(one.weight for one in constraints)], axis=0)
    known = weight >= grid.gsd**-2
    if not known.any():
        return known
    near: BoolArray = ndimage.distance_transform_edt(~known) <= reach
    return near
