"""Photoclinometry of one grid: slopes and albedo from images, integrated, again and again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.camera import SpcImage
from spcola.errors import InvalidValueError
from spcola.grids import Maplet
from spcola.grids.bending import bending_around
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.albedo_equations import albedo_information
from spcola.photometry.photoclinometry.constraints import HeightConstraint, constrained_points
from spcola.photometry.photoclinometry.function_errors import FunctionErrors
from spcola.photometry.photoclinometry.judging import LEAST_DETERMINED, outcome_of
from spcola.photometry.photoclinometry.left_over import area_left_over
from spcola.photometry.photoclinometry.nuisances import nuisance_values, with_contrast
from spcola.photometry.photoclinometry.options import PhotoclinometryOptions
from spcola.photometry.photoclinometry.result import Outcome, Photoclinometry
from spcola.photometry.photoclinometry.surface import cell_slopes
from spcola.photometry.photoclinometry.surface_equations import (
    albedo_sigma_of,
    determined_directions,
    height_equations,
    reduce_albedo,
)
from spcola.photometry.photoclinometry.surface_fit import SurfaceFit
from spcola.photometry.photoclinometry.undetermined_axis import UndeterminedAxis, cell_azimuths
from spcola.photometry.secondary_light import SecondaryLight
from spcola.shape import RayCaster

# Sigma of a mean height that nothing determines, GSDs; without it the equations are singular.
_UNKNOWN_MEAN = 1000.0
# Cells from a height with an error of its own within which it measures tops of boulders and errors
# of slopes.
_NEAR_CELLS = 2.0
# Slopes of ground that images do not determine at all depart from those of the start by so many
# times as much as others: shadows fall where it is steep.
_UNSEEN = 2.0
# Bending larger than this many medians of the grid counts as a boulder's. Errors of heights on
# ordinary ground are those of brightness.
_ORDINARY = 1.5


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
    fit = SurfaceFit.of(start, images, states, tuple(constraints), beyond, lights, options)
    if fit.high < 2 and float(np.mean(fit.precise)) < LEAST_DETERMINED:
        return _kept(fit, Outcome.TOO_FEW_IMAGES)
    turned = fit.with_turned_suns()
    for factor in options.levels:
        fit.level(factor)
        if factor == options.levels[0]:
            turned.level(factor)
            fit.light_ratio = turned.residual / fit.residual
    return _result(fit)


def _result(fit: SurfaceFit) -> Photoclinometry:
    """Judge the fits, and return the surface, or the start if it was better."""
    fits = fit.image_fits()
    options = fit.options
    sums = fit.sums(least_elevation=np.radians(options.least_elevation_deg))
    before, prior, contrast = with_contrast(
        nuisance_values(fit.states), fit.known, options.contrast_sigma
    )
    own = albedo_information(sums, options.slope_sigma)
    expected = options.albedo_prior.among_neighbours(own, fit.surface.albedo)
    reduced = reduce_albedo(sums, fit.surface, before, prior, expected)
    directions = determined_directions(reduced, options.determined_sigma)
    determined = float(np.mean((directions == 2) | fit.precise))
    left_over = area_left_over(fit.windows, fit.surface, fit.states, options)
    of_one = reduced.slopes, directions == 1, fit.start.grid
    axis, azimuth = UndeterminedAxis.of(*of_one), cell_azimuths(*of_one)
    outcome, reason = outcome_of(fit.before, fits, fit.rounds, determined, axis, options)
    if outcome is Outcome.DIVERGED:
        return replace(_kept(fit, outcome), reason=reason)
    known = np.any([fit.start.valid, *(one.weight > 0.0 for one in fit.constraints)], axis=0)
    touched = at_cells(np.pad(directions.astype(np.float64), 1)) > 0.0
    known |= touched
    # Others must not determine the images' parameters either, as if their surface were known.
    trusted = reduce_albedo(sums.of_cells(directions == 2), fit.surface, before, prior, expected)
    farthest = _UNKNOWN_MEAN * fit.surface.gsd
    counted = fit.priors_in_sigmas(_slope_sigma(fit, directions))
    equations = height_equations(trusted, fit.surface, counted, options, most_m=farthest)
    posterior = equations.posterior(contrast, options.contrast_sigma)
    bend, top, finer = _bend_errors(fit)
    by_function = FunctionErrors.of(fit)
    height_sigma = np.sqrt(posterior.heights() + by_function.heights + bend**2 + top**2)
    maplet = replace(
        fit.start,
        height=np.where(known, fit.surface.height, np.nan),
        albedo=options.convention.stated(fit.surface.point_albedo()),
        sigma=np.where(known, height_sigma, np.nan),
        # Errors of the states are in the sigmas of the heights.
        center_sigma=np.zeros(3),
    )
    gsd = maplet.grid.gsd
    sloped = np.isfinite(cell_slopes(maplet.height, gsd))
    # What the grid does not resolve is independent at the four points of a cell.
    slope_variance = posterior.slopes(gsd) + at_cells(bend**2 + finer**2) / gsd**2
    slope_variance += by_function.slopes
    slope_sigma = np.where(sloped, np.sqrt(slope_variance), np.nan)
    albedo_sigma = np.hypot(
        albedo_sigma_of(reduced, posterior, options), np.sqrt(by_function.albedo)
    )
    # Images count less than a prior of `albedo_sigma`: unknown, as on fixed topography.
    by_images = reduced.albedo.weight - expected.information
    albedo_sigma[by_images < options.albedo_sigma**-2.0] = np.nan
    albedo_sigma = options.convention.stated(albedo_sigma)
    return Photoclinometry(
        maplet, directions, azimuth, slope_sigma, albedo_sigma, fits, fit.start_fits,
        tuple(fit.rounds), outcome, reason, fit.light_ratio, fit.shift_ratio,
        tuple(one.fit(maplet) for one in fit.constraints), axis, left_over,
    )  # fmt: skip


def _slope_sigma(fit: SurfaceFit, directions: AnyArray) -> FloatArray:
    """Return the standard deviation of the slopes of cells (R − 1, C − 1) of the start.

    Heights add up its errors from cell to cell as far as to the next height that is measured. There
    it is that of single slopes, and elsewhere that of independent ones which would add up to the
    departure of the heights: s GSD about their mean, on 99 × 99 points, with a sigma of s. That is
    seen where images determine slopes.
    """
    options = fit.options
    away = (fit.surface.height - fit.start.height) / fit.surface.gsd
    slopes = cell_slopes(away, 1.0)
    measured = constrained_points(_measuring(fit), fit.start.grid, _NEAR_CELLS)
    near = (at_cells(measured.astype(np.float64)) == 1.0) & np.isfinite(slopes[0])
    sigma = np.full(directions.shape, options.slope_error_factor * options.slope_sigma)
    if not options.independent_start:
        return np.where(near, options.slope_sigma, sigma)
    # Heights are settled to no better than this.
    least, departure = options.settled_gsd, _departure(away, directions)
    if np.isfinite(departure):
        sigma = max(departure, least) * np.where(directions == 0, _UNSEEN, 1.0)
    if np.mean(near) < LEAST_DETERMINED:
        return sigma
    single = max(float(np.sqrt(np.mean(slopes[:, near] ** 2))), least)
    return np.where(near, single, sigma)


def _measuring(fit: SurfaceFit) -> tuple[HeightConstraint, ...]:
    """Return the constraints that show relief of single cells, boulders among it."""
    return tuple(one for one in fit.constraints if one.shows_cells)


def _departure(away: FloatArray, directions: AnyArray) -> float:
    """Return the standard deviation of heights `away` from the start, GSDs; NaN if not known.

    It is that of points around which images determine both directions of the slope. If these are
    few, it is that of points with one direction, where half of the departure's square is seen.
    """
    for least, unseen in ((2, 1.0), (1, 2.0)):
        around = at_cells(np.pad((directions >= least).astype(np.float64), 1)) == 1.0
        seen = away[around & np.isfinite(away)]
        if seen.size >= LEAST_DETERMINED * away.size:
            return float(np.sqrt(unseen * np.var(seen)))
    return float("nan")


def _bend_errors(fit: SurfaceFit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors of heights (R, C) where the surface bends, m: single ones, and whole tops.

    The last are those of relief finer than the grid, which single slopes show: it is everywhere,
    also where the grid is smooth, and bends like ordinary ground.
    """
    bend = bending_around(fit.surface.height)
    usual = float(np.median(bend))
    ordinary = _ORDINARY * usual
    excess = np.sqrt(np.maximum(bend**2 - ordinary**2, 0.0))
    options, grid = fit.options, fit.start.grid
    measuring = _measuring(fit)
    own = constrained_points(measuring, grid, 0.0)
    bend_sigma = np.where(own, options.measured_bend_sigma, options.bend_sigma)
    means = tuple(one for one in measuring if one.blur is not None)
    others = tuple(one for one in measuring if one.blur is None)
    top_sigma = np.where(
        constrained_points(means, grid, _NEAR_CELLS), options.averaged_top_sigma, options.top_sigma
    )
    near = constrained_points(others, grid, _NEAR_CELLS)
    top_sigma = np.where(near, options.measured_top_sigma, top_sigma)
    return bend_sigma * bend, top_sigma * excess, bend_sigma * usual


def _kept(fit: SurfaceFit, outcome: Outcome) -> Photoclinometry:
    """Return the start surface as it was, and how images fit it."""
    cells = fit.start.grid.size - 1
    return Photoclinometry(
        fit.start,
        np.zeros((cells, cells), dtype=np.int8),
        np.full((cells, cells), np.nan),
        np.full((2, cells, cells), np.nan),
        np.full((cells, cells), np.nan),
        fit.start_fits,
        fit.start_fits,
        tuple(fit.rounds),
        outcome,
        f"{fit.count} of {len(fit.images)} images show enough lit ground of it, {fit.high} with "
        f"the Sun {fit.options.least_elevation_deg:.0f}° high; two are needed, or precise heights",
        fit.light_ratio,
        fit.shift_ratio,
        tuple(one.fit(fit.start) for one in fit.constraints),
    )
