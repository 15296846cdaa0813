"""What photoclinometry found: surface, albedo, and how well each image fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from spcola.arrays import AnyArray, FloatArray
from spcola.grids import Maplet
from spcola.photometry.ground import at_cells
from spcola.photometry.photoclinometry.constraints import ConstraintFit
from spcola.photometry.photoclinometry.undetermined_axis import UndeterminedAxis


class Outcome(StrEnum):
    """How photoclinometry of a grid ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not-converged"
    """Heights, albedo or residuals of brightness still changed in the last round."""
    UNDETERMINED = "undetermined"
    """Images determine both directions of the slope in few cells, and no precise height constrains
    the others: heights depend on the start there, and their sigmas are large."""
    TOO_FEW_IMAGES = "too-few-images"
    """Fewer than two images show enough ground in high enough light, and no precise height
    constrains it: the start surface is kept."""
    DIVERGED = "diverged"
    """The brightness fits worse than that of the start surface, which is kept."""


class Fit(StrEnum):
    """How an image was used."""

    USED = "used"
    NOT_SEEN = "not-seen"
    """It does not show the grid, or the ground there is in shadow, hidden or saturated."""
    SUN_REVERSED = "sun-reversed"
    """Its brightness fits better with the Sun on the other side."""
    CONTRADICTS = "contradicts"
    """Its brightness does not correlate with the surface that the other images determine."""


@dataclass(frozen=True)
class ImageFit:
    """How an image fits the surface.

    Parameters
    ----------
    name : str
    fit : Fit
    scale : float
        λ: brightness of ground of relative albedo 1 and Φ = 1, in the image's numbers [16].
    shift_px : tuple of 2 float
        Correction of sample and line of the grid in the image.
    residual : float
        Robust standard deviation of its brightness about the expected one, relative; pixels finer
        than the grid are averaged in blocks.
    correlation : float
        Of both; NaN without pixels.
    pixels : int
        Number of pixels, or blocks, compared.
    gradient : tuple of 2 float
        Relative change of λ along the grid's x and y, from its centre to its edge.
    noise : float
        Part of `residual` that neighbouring pixels do not share, relative: what remains where the
        model fits. NaN where it has too few neighbours.
    pixel_m : float
        Side of a square of the area that a pixel covers on the plane of the grid, metres.
    """

    name: str
    fit: Fit
    scale: float
    shift_px: tuple[float, float]
    residual: float
    correlation: float
    pixels: int
    gradient: tuple[float, float]
    noise: float
    pixel_m: float

    @classmethod
    def not_seen(cls, name: str) -> ImageFit:
        """Return the fit of an image that does not show the grid.

        Parameters
        ----------
        name : str
        """
        nan = float("nan")
        return cls(name, Fit.NOT_SEEN, nan, (nan, nan), nan, nan, 0, (nan, nan), nan, nan)


@dataclass(frozen=True)
class Round:
    """Changes in one round.

    Parameters
    ----------
    gsd : float
        Metres.
    residual : float
        Median over images of the relative residual of brightness, before the round.
    height_m : float
        Robust standard deviation of the changes of heights, metres.
    albedo : float
        Root mean square of the changes of albedo.
    """

    gsd: float
    residual: float
    height_m: float
    albedo: float


def residual_change(rounds: Sequence[Round]) -> float:
    """Return by how much the residual of brightness changed between the last two rounds of a level.

    Infinite where the last one is the first of its level, or first has a residual; 0 without any.

    Parameters
    ----------
    rounds : sequence of Round
        One at least.
    """
    if len(rounds) < 2 or rounds[-2].gsd != rounds[-1].gsd:
        return float("inf")
    before, last = rounds[-2].residual, rounds[-1].residual
    if np.isnan(before) and np.isnan(last):
        return 0.0
    change = abs(last - before)
    return change if np.isfinite(change) else float("inf")


@dataclass(frozen=True, eq=False)
class Photoclinometry:
    """A surface from images.

    Attributes
    ----------
    maplet : Maplet
        Heights, relative albedo, sigma of heights.
    directions : (R − 1, C − 1) ndarray of int
        In how many directions images determine the slope of each cell: 0, 1 or 2.
    undetermined_azimuth_deg : (R − 1, C − 1) ndarray
        Of cells with one direction the axis along which it is not determined, in the plane of the
        grid, from north towards east, 0 … 180; NaN for other cells.
    slope_sigma : (2, R − 1, C − 1) ndarray
        Of ∂h/∂x and ∂h/∂y of the heights, by images, stereo and constraints; NaN where one of the
        four heights is unknown, or they are those of the start.
    albedo_sigma : (R − 1, C − 1) ndarray
        NaN where high images determine the albedo less than a prior of `albedo_sigma` does, such as
        in shadow: the albedo of the maplet is that of the ground around there, or of the start.
    images, start_images : tuple of ImageFit
        How each fits the surface, or the start where that is kept; and how each fits the start.
    rounds : tuple of Round
        Those done, also of a surface that was given up.
    outcome : Outcome
    reason : str
        Why it ended so, in one clause.
    light_ratio : float
        Residual of brightness with the Suns of all images turned by half a turn about the normal,
        over that with the Suns as stated, on the coarsest level; NaN if that was not solved. Hills
        are hollows then: below 1 the directions of the Suns, or the photometric function, are
        doubtful. One maplet alone hardly decides it.
    shift_ratio : float
        Median over images of their shifts over what their states leave of it, in sigmas: much more
        than 1 where constraining heights are displaced, or the states of many images wrong. NaN
        without images.
    constraints : tuple of ConstraintFit
        How each constraint fits, in their order.
    undetermined_axis : UndeterminedAxis
        Along which slopes are not determined, in the cells with one direction.
    left_over : float
        Relative residual of brightness of the largest area that most images leave over: ground of
        another albedo than the prior expects, or relief that the start lacks. Its slopes are wrong.
        NaN if there is none.
    """

    maplet: Maplet
    directions: AnyArray
    undetermined_azimuth_deg: FloatArray
    slope_sigma: FloatArray
    albedo_sigma: FloatArray
    images: tuple[ImageFit, ...]
    start_images: tuple[ImageFit, ...]
    rounds: tuple[Round, ...]
    outcome: Outcome
    reason: str
    light_ratio: float
    shift_ratio: float
    constraints: tuple[ConstraintFit, ...] = ()
    undetermined_axis: UndeterminedAxis = field(default_factory=UndeterminedAxis)
    left_over: float = float("nan")

    @property
    def point_albedo_sigma(self) -> FloatArray:
        """Sigma (R, C) of the albedo of points: means of those of their cells that are known."""
        return at_cells(np.pad(self.albedo_sigma, 1, mode="edge"))

    @property
    def kept_start(self) -> bool:
        """Whether heights and albedo are those of the start."""
        return self.outcome in (Outcome.TOO_FEW_IMAGES, Outcome.DIVERGED)
