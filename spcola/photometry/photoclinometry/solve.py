"""Photoclinometry of one grid: slopes and albedo from images, integrated, again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from spcola.arrays import BoolArray, FloatArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError
from spcola.grids import Maplet, MapletGrid
from spcola.grids.bending import bending_around
from spcola.grids.gaps import filled
from spcola.math.robust import mad
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.cell_pixels import NUISANCES
from spcola.photometry.photoclinometry.constraints import (
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
from spcola.photometry.photoclinometry.judging import LEAST_DETERMINED, image_fits, outcome_of
from spcola.photometry.photoclinometry.nuisances import (
    changed_state,
    nuisance_priors,
    nuisance_values,
    shift_ratio,
    with_contrast,
)
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.result import ImageFit, Outcome, Photoclinometry, Round
from spcola.photometry.photoclinometry.surface import Surface, cell_slopes, resampled_points
from spcola.photometry.photoclinometry.surface_equations import (
    Priors,
    Reduced,
    albedo_sigma_of,
    changed_albedo,
    determined_directions,
    height_equations,
    reduce_albedo,
)
from spcola.photometry.secondary_light import SecondaryLight
from spcola.shape import RayCaster

# Standard deviation of the change of the mean height in a round, GSDs.
_MOST_RISE = 3.0
# Sigma of a mean height that nothing determines, GSDs; without it the equations are singular.
_UNKNOWN_MEAN = 1000.0
# Outliers are weighed down little by little: on a smooth start boulders are the largest of them,
# and would never rise. In the first round of the finest level the loss is so many times as wide, in
# each further one by this factor less, down to its own width. Coarser ones do not resolve boulders.
_WIDE, _NARROWER = 4.0, 0.7
# Cells from a constraining height within which it measures the top of a boulder.
_MEASURED_CELLS = 2.0


def solve_photoclinometry(
    start: Maplet,
    images: Sequence[SpcImage],
    states: Mapping[str, FloatArray],
    *,
    constraints: Sequence[HeightConstraint] = (),
    beyond: Sequence[RayCaster] = (),
    secondary: Mapping[str, SecondaryLight] | None = None,
    options: PhotoclinometryOptions | None = None,
) -> Photoclinometry:
    """Return heights and albedo of a grid from the brightness of its images.

    Each round predicts the pixels of all images [16], sums the normal equations of slopes, mean
    height and albedo of each cell over them [20, 21], eliminates albedo, scale and shift of the
    images, and integrates [22, 23], with the information of each cell as weight and heights as
    constraints. A change of height also displaces ground in oblique images: stereo is in the same
    equations. Coarse grids come first.

    Parameters
    ----------
    start : Maplet
        Grid, heights (a shape's, or a coarser maplet's), albedo. NaN heights are interpolated for
        the start; they stay unknown where no image determines a slope and nothing constrains them,
        and beyond the outermost known ones.
    images : sequence of SpcImage
        With pixels, in the frame of the grid.
    states : mapping of str to (6, 6) ndarray
        Covariances of their states, as :func:`spcola.control.estimation.state_covariance`: how far
        each image may be shifted.
    constraints : sequence of HeightConstraint
        On the grid. Without any, the mean height is that of stereo alone.
    beyond : sequence of RayCaster, optional
        Surfaces that hide and shade ground of the grid: the whole body, maplets around. Rays start
        outside the square of the grid.
    secondary : mapping of str to SecondaryLight, optional
        Light from other ground on the grid, of the images that are used only where the Sun does not
        light it. Their thresholds enclose the brightness of the shade. An image of both kinds is
        given twice, under two names.
    options : PhotoclinometryOptions, optional

    Raises
    ------
    InvalidValueError
        If the start has no height at all, or an image no pixels.
    """
    options = options or PhotoclinometryOptions()
    if not start.valid.any():
        raise InvalidValueError("has no height to start from", start.name)
    for image in images:
        if image.pixels is None:
            raise InvalidValueError("has no pixels", image.name, "put its .DAT into IMAGEFILES")
    lights = dict(secondary or {})
    work = _Work.of(start, images, states, tuple(constraints), beyond, lights, options)
    if work.count < 2 or (work.high < 2 and float(np.mean(work.precise)) < LEAST_DETERMINED):
        return _kept(work, (), Outcome.TOO_FEW_IMAGES)
    turned = work.with_turned_suns()
    for factor in options.levels:
        work.level(factor)
        if factor == options.levels[0]:
            turned.level(factor)
            work.light_ratio = turned.residual / work.residual
    return _result(work)


@dataclass(eq=False)
class _Work:
    """What changes from round to round."""

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
    before: list[float]
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
    ) -> _Work:
        grid = start.grid
        albedo = options.convention.relative(at_cells(start.albedo))
        surface = Surface(grid, filled(start.height), albedo)
        coarsest = grid.with_gsd(grid.gsd * options.levels[0])
        coarse = resampled_points(surface.height, grid, coarsest)
        known = nuisance_priors(images, states, grid.center, options)
        within = resampled_points(_interpolated(start, constraints, options), grid, coarsest)
        opened = [open_ground(image, coarsest, coarse, beyond) for image in images]
        work = cls(
            start, images, constraints, secondary, options, known,
            [(np.minimum(seen, within), lit) for seen, lit in opened],
            coarsest, surface, [ImageState.unknown() for _ in images], [], [], [],
        )  # fmt: skip
        work.windows = work.cut(grid, surface.height)
        work.before = [fit.residual for fit in work.fits()]
        return work

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

    @property
    def bend_errors(self) -> tuple[FloatArray, FloatArray]:
        """Errors of heights (R, C) where the surface bends, m: single ones, and of whole tops."""
        bend, options = bending_around(self.surface.height), self.options
        measured = constrained_points(self.constraints, self.start.grid, _MEASURED_CELLS)
        return options.bend_sigma * bend, np.where(measured, 0.0, options.top_sigma) * bend

    def fits(self) -> tuple[ImageFit, ...]:
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

    def with_turned_suns(self) -> _Work:
        """Return the same before the first round, the Sun on the other side of the grid's normal.

        Relief seen in such light has its hills where the images have hollows: their brightness
        fits as well in each, and only stereo shows which is right.
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
                return

    def enter(self, factor: int) -> None:
        """Go on with a level of a GSD that is `factor` times the grid's."""
        whole = self.start.grid
        grid = whole if factor == 1 else whole.with_gsd(factor * whole.gsd)
        self.surface = self.surface.on(grid)
        slopes = cell_slopes(resampled_points(filled(self.start.height), whole, grid), grid.gsd)
        self.priors = Priors(slopes, *gathered(self.constraints, whole, grid))
        self.windows = self.cut(grid, self.surface.height)

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
        return reduce_albedo(sums, self.surface, before, self.known, self.options.albedo_sigma)

    def round_priors(self) -> Priors:
        """Return what counts in the next round: a random share of the heights, or all."""
        assert self.priors is not None
        fraction = self.options.constraint_fraction
        if fraction == 1.0:
            return self.priors
        generator = np.random.default_rng([self.options.seed, len(self.rounds)])
        some = tuple(one.subset(fraction, generator) for one in self.constraints)
        heights = gathered(some, self.start.grid, self.surface.grid)
        return Priors(self.priors.slopes, *heights)

    def round(self, *, widened: float = 1.0) -> bool:
        """Do one round; return whether heights and albedo have settled.

        They have not while the loss is `widened`.
        """
        surface, options, priors = self.surface, self.options, self.round_priors()
        reduced = self.reduced(widened)
        most = _MOST_RISE * surface.gsd
        equations = height_equations(reduced, surface, priors, options, most_m=most)
        rise, nuisance = equations.solve()
        albedo = changed_albedo(reduced, surface, rise, nuisance, options.convention)
        residual = float(np.nanmedian([state.spread for state in self.states]))
        # Ground that nothing determines, and ground that a shadow enters or leaves, never settles.
        moved, brightened = float(mad(rise)), float(np.std(albedo - surface.albedo))
        self.rounds.append(Round(surface.gsd, residual, moved, brightened))
        steps = nuisance.reshape(-1, NUISANCES)
        self.states = [changed_state(*one) for one in zip(self.states, steps, strict=True)]
        self.surface = Surface(surface.grid, surface.height + rise, albedo)
        settled = widened == 1.0 and moved < options.settled_gsd * surface.gsd
        return settled and brightened < options.settled_albedo


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


def _result(work: _Work) -> Photoclinometry:
    """Judge the fits, and return the surface, or the start if it was better."""
    assert work.priors is not None
    fits = work.fits()
    options = work.options
    sums = work.sums(least_elevation=np.radians(options.least_elevation_deg))
    sums = sums.weakened(options.error_factor)
    before, prior, contrast = with_contrast(
        nuisance_values(work.states), work.known, options.contrast_sigma
    )
    reduced = reduce_albedo(sums, work.surface, before, prior, options.albedo_sigma)
    directions = determined_directions(reduced, options.determined_sigma)
    determined = float(np.mean((directions == 2) | work.precise))
    outcome, reason = outcome_of(work.before, fits, work.rounds, determined, options)
    if outcome is Outcome.DIVERGED:
        return replace(_kept(work, fits, outcome), reason=reason)
    known = np.any([work.start.valid, *(one.weight > 0.0 for one in work.constraints)], axis=0)
    touched = at_cells(np.pad(directions.astype(np.float64), 1)) > 0.0
    known |= touched
    trusted = reduced.of_cells(directions == 2)
    farthest = _UNKNOWN_MEAN * work.surface.gsd
    equations = height_equations(trusted, work.surface, work.priors, options, most_m=farthest)
    posterior = equations.posterior(contrast, options.contrast_sigma)
    bend, top = work.bend_errors
    height_sigma = np.sqrt(posterior.heights() + bend**2 + top**2)
    maplet = replace(
        work.start,
        height=np.where(known, work.surface.height, np.nan),
        albedo=options.convention.stated(work.surface.point_albedo()),
        sigma=np.where(known, height_sigma, np.nan),
        # Errors of the states are in the sigmas of the heights.
        center_sigma=np.zeros(3),
    )
    gsd = maplet.grid.gsd
    sloped = np.isfinite(cell_slopes(maplet.height, gsd))
    # What the grid does not resolve is independent at the four points of a cell.
    slope_variance = posterior.slopes(gsd) + at_cells(bend**2) / gsd**2
    slope_sigma = np.where(sloped, np.sqrt(slope_variance), np.nan)
    albedo_sigma = options.convention.stated(albedo_sigma_of(reduced, posterior, options))
    return Photoclinometry(
        maplet, directions, slope_sigma, albedo_sigma, fits, tuple(work.rounds), outcome, reason,
        work.light_ratio, work.shift_ratio, tuple(one.fit(maplet) for one in work.constraints),
    )  # fmt: skip


def _kept(work: _Work, fits: tuple[ImageFit, ...], outcome: Outcome) -> Photoclinometry:
    """Return the start surface as it was."""
    cells = work.start.grid.size - 1
    fits = fits or work.fits()
    return Photoclinometry(
        work.start,
        np.zeros((cells, cells), dtype=np.int8),
        np.full((2, cells, cells), np.nan),
        np.full((cells, cells), work.options.albedo_sigma),
        fits,
        tuple(work.rounds),
        outcome,
        f"{work.count} of {len(work.images)} images show enough lit ground of it, {work.high} with "
        f"the Sun {work.options.least_elevation_deg:.0f}° high; two are needed",
        work.light_ratio,
        work.shift_ratio,
        tuple(one.fit(work.start) for one in work.constraints),
    )
