"""Rounds of photoclinometry: images predicted, equations summed, surface changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from spcola.arrays import AnyArray, BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.grids import Maplet, MapletGrid
from spcola.grids.gaps import filled
from spcola.math.robust import known_median, mad
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES
from spcola.photometry.photoclinometry.constraints import (
    GridHeights,
    HeightConstraint,
    constrained_points,
    gathered,
)
from spcola.photometry.photoclinometry.image_equations import ImageState, Sums, add_image
from spcola.photometry.photoclinometry.image_window import (
    GridPoints,
    ImageWindow,
    open_ground,
    window_over,
)
from spcola.photometry.photoclinometry.judging import LEAST_DETERMINED, image_fits
from spcola.photometry.photoclinometry.left_over import albedo_of_areas
from spcola.photometry.photoclinometry.nuisances import (
    changed_state,
    nuisance_priors,
    nuisance_values,
    shift_ratio,
)
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.result import ImageFit, Round, residual_change
from spcola.photometry.photoclinometry.surface import Surface, cell_slopes, resampled_points
from spcola.photometry.photoclinometry.surface_equations import (
    Priors,
    Reduced,
    changed_albedo,
    determined_directions,
    height_equations,
    reduce_albedo,
)
from spcola.photometry.secondary_light import SecondaryLight
from spcola.shape import RayCaster

# Standard deviation of the change of the mean height in a round, GSDs.
_MOST_RISE = 3.0
# Outliers are weighed down little by little: on a smooth start boulders are the largest of them,
# and would never rise. In the first round of the finest level the loss is so many times as wide, in
# each further one by this factor less, down to its own width. Coarser ones do not resolve boulders.
_WIDE, _NARROWER = 4.0, 0.7
# Images that are blurred slow down the short waves of sharper ones, which share their equations but
# not their waves: there rounds go on until heights change by less, by this factor where images fit
# as well as the smallest error allows. Further rounds let noise in, so that from twice that error
# on it is 1.
_MIXED = 0.1
# How many times as many points share an error of a shape as in the solution, which is better with
# its long waves, where such errors are small.
_MORE_COMMON = 4.0


@dataclass(eq=False)
class SurfaceFit:
    """The surface of a grid from round to round, and what it is solved from.

    Parameters
    ----------
    start : Maplet
    images : sequence of SpcImage
    constraints : tuple of HeightConstraint
    secondary : dict of str to SecondaryLight
    options : PhotoclinometryOptions
        All as given to :func:`spcola.photometry.photoclinometry.solve_photoclinometry`.
    known : (K, M, M) ndarray
        Prior information on the nuisance parameters of K images.
    open : list of (ndarray, ndarray)
        Shares of the points of the coarsest grid that each image sees, and that the Sun lights.
    coarsest : MapletGrid
    surface : Surface
    states : list of ImageState
    windows : list of ImageWindow or None
        None for images that do not show the grid.
    rounds : list of Round
        Those done.
    start_fits : tuple of ImageFit
        How each image fits the start, before the first round.
    directions : (R − 1, C − 1) ndarray of int8
        In how many directions images determined the slopes of the cells in the last round.
    priors : Priors, optional
        On the grid of the level.
    light_ratio : float
        As of :class:`Photoclinometry`.
    """

    start: Maplet
    images: Sequence[SpcImage]
    constraints: tuple[HeightConstraint, ...]
    secondary: dict[str, SecondaryLight]
    options: PhotoclinometryOptions
    known: FloatArray
    open: list[tuple[FloatArray, FloatArray]]
    coarsest: MapletGrid
    surface: Surface
    states: list[ImageState]
    windows: list[ImageWindow | None]
    rounds: list[Round]
    start_fits: tuple[ImageFit, ...]
    directions: AnyArray
    priors: Priors | None = None
    light_ratio: float = float("nan")

    @classmethod
    def of(
        cls,
        start: Maplet,
        images: Sequence[SpcImage],
        states: Mapping[str, FloatArray],
        constraints: tuple[HeightConstraint, ...],
        beyond: Sequence[RayCaster],
        secondary: dict[str, SecondaryLight],
        options: PhotoclinometryOptions,
    ) -> SurfaceFit:
        """Return the start surface with its images cut, before the first round.

        Parameters
        ----------
        start, images, states, constraints, beyond, secondary, options
            As of :func:`spcola.photometry.photoclinometry.solve_photoclinometry`.
        """
        grid = start.grid
        albedo = options.convention.relative(at_cells(start.albedo))
        surface = Surface(grid, filled(start.height), albedo)
        coarsest = grid.with_gsd(grid.gsd * options.levels[0])
        coarse = resampled_points(surface.height, grid, coarsest)
        known = nuisance_priors(images, states, grid.center, options)
        within = resampled_points(_interpolated(start, constraints, options), grid, coarsest)
        opened = [open_ground(image, coarsest, coarse, beyond, grid) for image in images]
        fit = cls(
            start, images, constraints, secondary, options, known,
            [(np.minimum(seen, within), lit) for seen, lit in opened],
            coarsest, surface, [ImageState.unknown() for _ in images], [], [], (),
            np.zeros(albedo.shape, dtype=np.int8),
        )  # fmt: skip
        fit.windows = fit.cut(grid, surface.height)
        fit.start_fits = fit.image_fits()
        return fit

    @property
    def before(self) -> FloatArray:
        """Residual (K,) of each image for the start; NaN where it does not show the grid."""
        return np.array([one.residual for one in self.start_fits])

    @property
    def count(self) -> int:
        """The number of images that show the grid."""
        return int(np.count_nonzero(np.isfinite(self.before)))

    @property
    def high(self) -> int:
        """The number of these in which the Sun is high enough to determine slopes."""
        least = np.sin(np.radians(self.options.least_elevation_deg))
        seen = zip(self.windows, self.before, strict=True)
        return sum(w is not None and w.elevation_sine >= least and np.isfinite(b) for w, b in seen)

    @cached_property
    def precise(self) -> BoolArray:
        """Cells (R − 1, C − 1) whose heights constraints determine to better than the GSD.

        Slopes are known about those of the start by `slope_sigma`, so that within 1 / slope_sigma²
        cells of a height of such a sigma, errors of slopes that are independent add up to no more.
        """
        reach = self.options.slope_sigma**-2
        points = constrained_points(self.constraints, self.start.grid, reach)
        return at_cells(points.astype(np.float64)) > 0.0

    def image_fits(self) -> tuple[ImageFit, ...]:
        """Return how each image fits the surface."""
        names = [image.name for image in self.images]
        return image_fits(names, self.windows, self.surface, self.states, self.options)

    def cut(self, grid: MapletGrid, height: FloatArray) -> list[ImageWindow | None]:
        """Return the windows of all images over a grid.

        Blocks of pixels are those of the finest grid: on coarse ones single pixels show which side
        the Sun is on.
        """
        finest, ground = self.start.grid.gsd, GridPoints.of(grid, height)
        return [
            window_over(
                image,
                ground,
                self.coarsest,
                opened,
                finest_m=finest,
                light=self.secondary.get(image.name),
            )
            for image, opened in zip(self.images, self.open, strict=True)
        ]

    def with_turned_suns(self) -> SurfaceFit:
        """Return the same before the first round, the Sun on the other side of the grid's normal.

        Relief seen in such light has its hills where the images have hollows: their brightness
        fits as well in each, and only stereo shows which is right. Shadows of ground around stay as
        they are, so that the same pixels count.
        """
        axes = self.start.grid.axes
        turn = axes.T @ np.diag([-1.0, -1.0, 1.0]) @ axes
        images = [
            image if image.name in self.secondary else replace(image, sun=turn @ image.sun)
            for image in self.images
        ]
        lights = {name: light.turned() for name, light in self.secondary.items()}
        unknown = [ImageState.unknown() for _ in images]
        return replace(self, images=images, secondary=lights, states=unknown, rounds=[])

    @property
    def shift_ratio(self) -> float:
        """Median shift of the images that show the grid, in sigmas of their states."""
        shown = np.isfinite(self.before)
        states = [state for state, one in zip(self.states, shown, strict=True) if one]
        return shift_ratio(states, self.known[shown])

    @cached_property
    def mixed(self) -> bool:
        """Whether images that show the grid are blurred differently."""
        shown = (window.name for window in self.windows if window is not None)
        return len({self.options.blur_of(name) for name in shown}) > 1

    def settled_gsd(self, residual: float) -> float:
        """Change of heights, GSDs, at which a level ends; smaller for images of mixed blur."""
        if not self.mixed:
            return self.options.settled_gsd
        power = float(np.clip(2.0 - residual / self.options.least_error, 0.0, 1.0))
        return self.options.settled_gsd * _MIXED**power

    @property
    def residual(self) -> float:
        """Median residual of brightness of the images in the last round, relative."""
        return self.rounds[-1].residual

    def level(self, factor: int) -> None:
        """Do the rounds of a level of a GSD that is `factor` times the grid's."""
        self.enter(factor)
        widest = _WIDE if factor == 1 else 1.0
        for number in range(self.options.rounds):
            # The last round has the loss that was asked for.
            last = number + 1 == self.options.rounds
            if self.round(widened=1.0 if last else max(1.0, widest * _NARROWER**number)):
                break
        if factor > 1:
            self.surface = replace(self.surface, albedo=self.albedo_of_areas())

    def albedo_of_areas(self) -> FloatArray:
        """Return the albedo, that of areas which are far from expected as images show it."""
        albedo = albedo_of_areas(self.windows, self.surface, self.states, self.options)
        return self.options.convention.bounded(albedo)

    def enter(self, factor: int) -> None:
        """Go on with a level of a GSD that is `factor` times the grid's."""
        whole = self.start.grid
        if factor == 1 and self.rounds:
            self.constraints = tuple(
                self.as_seen(one) if one.least_sigma else one for one in self.constraints
            )
        grid = whole if factor == 1 else whole.with_gsd(factor * whole.gsd)
        self.surface = self.surface.on(grid)
        slopes = cell_slopes(resampled_points(filled(self.start.height), whole, grid), grid.gsd)
        heights = gathered(self.constraints, whole, grid)
        self.priors = Priors(slopes, self.options.slope_sigma, *heights)
        self.windows = self.cut(grid, self.surface.height)

    def as_seen(self, constraint: HeightConstraint) -> HeightConstraint:
        """Return heights of unknown sigma with the one that the surface of the level shows.

        Points count around which images determine both directions of the slope.
        """
        seen = at_cells(np.pad((self.directions == 2).astype(np.float64), 1)) == 1.0
        heights = GridHeights.of([constraint], self.start.grid, self.surface.grid)
        seen &= heights.weight > 0.0
        if np.mean(seen) < LEAST_DETERMINED:
            return constraint
        return constraint.as_seen(heights.above(self.surface.height)[seen])

    def priors_in_sigmas(self, slope_sigma: FloatArray) -> Priors:
        """Return what counts in sigmas: heights whose sigma images showed weigh less.

        Errors of a shape are common to more points than the solution assumes. `slope_sigma` is that
        of the slopes of the start (R − 1, C − 1).
        """
        assert self.priors is not None
        counted = tuple(
            replace(one, weight=one.weight / _MORE_COMMON) if one.least_sigma else one
            for one in self.constraints
        )
        heights = gathered(counted, self.start.grid, self.surface.grid)
        return Priors(self.priors.slopes, slope_sigma, *heights)

    def sums(self, *, least_elevation: float = 0.0, widened: float = 1.0) -> Sums:
        """Return the normal equations of images with the Sun at least so high (rad), summed.

        The scales and spreads of the images are changed to those of the surface. Outliers are those
        of a loss that is `widened` by a factor.
        """
        surface = self.surface
        options = replace(self.options, loss_scale=widened * self.options.loss_scale)
        sums = Sums.empty(len(self.images), surface.albedo.shape)
        for k, window in enumerate(self.windows):
            if window is not None and window.elevation_sine >= np.sin(least_elevation):
                self.states[k] = add_image(sums, k, window, surface, self.states[k], options)
        return sums

    def reduced(self, widened: float) -> Reduced:
        """Return the normal equations of the cells for a round, with a loss so many times wider."""
        before, sums = nuisance_values(self.states), self.sums(widened=widened)
        expected = self.options.albedo_prior.about(self.surface.albedo)
        return reduce_albedo(sums, self.surface, before, self.known, expected)

    def round_priors(self) -> Priors:
        """Return what counts in the next round: a random share of the heights, or all."""
        assert self.priors is not None
        fraction = self.options.constraint_fraction
        if fraction == 1.0:
            return self.priors
        generator = np.random.default_rng([self.options.seed, len(self.rounds)])
        some = tuple(one.subset(fraction, generator) for one in self.constraints)
        heights = gathered(some, self.start.grid, self.surface.grid)
        return Priors(self.priors.slopes, self.options.slope_sigma, *heights)

    def round(self, *, widened: float = 1.0) -> bool:
        """Do one round; return whether heights, albedo and residuals have settled.

        They have not while the loss is `widened`.
        """
        surface, options, priors = self.surface, self.options, self.round_priors()
        reduced = self.reduced(widened)
        most = _MOST_RISE * surface.gsd
        self.directions = determined_directions(reduced, options.determined_sigma)
        equations = height_equations(reduced, surface, priors, options, most_m=most)
        rise, nuisance = equations.solve()
        albedo = changed_albedo(reduced, surface, rise, nuisance, options.convention)
        residual = float(known_median(np.array([state.spread for state in self.states])))
        # Ground that nothing determines, and ground that a shadow enters or leaves, never settles.
        moved, brightened = float(mad(rise)), float(np.std(albedo - surface.albedo))
        self.rounds.append(Round(surface.gsd, residual, moved, brightened))
        steps = nuisance.reshape(-1, NUISANCES)
        self.states = [changed_state(*one) for one in zip(self.states, steps, strict=True)]
        self.surface = Surface(surface.grid, surface.height + rise, albedo)
        return (
            widened == 1.0
            and moved < self.settled_gsd(residual) * surface.gsd
            and brightened < options.settled_albedo
            and residual_change(self.rounds) < options.settled_residual
        )


def _interpolated(
    start: Maplet, constraints: tuple[HeightConstraint, ...], options: PhotoclinometryOptions
) -> FloatArray:
    """Return 1 at points (R, C) whose height is known or lies between known ones, and else 0.

    What images show beyond, past the brink of a cliff or the limb of a small body, is other ground.
    """
    known = np.any([start.valid, *(one.weight > 0.0 for one in constraints)], axis=0)
    reach = np.ones((2 * options.levels[0] + 1,) * 2, dtype=np.bool_)
    between = ndimage.binary_fill_holes(known) | ndimage.binary_dilation(known, reach)
    return np.asarray(between, dtype=np.float64)
