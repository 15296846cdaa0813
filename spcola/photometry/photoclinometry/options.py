"""Options of photoclinometry."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from spcola.errors import SettingsError
from spcola.photometry.functions import PhotometricFunction, lunar_lambert
from spcola.photometry.image_blur import ImageBlur, ImageBlurs
from spcola.photometry.photoclinometry.albedo_convention import AlbedoConvention
from spcola.photometry.photoclinometry.albedo_prior import AlbedoPrior
from spcola.photometry.secondary_light import name_of_image


@dataclass(frozen=True)
class PhotoclinometryOptions:
    """Options of :func:`spcola.photometry.photoclinometry.solve_photoclinometry`.

    Parameters
    ----------
    function : PhotometricFunction
    psf_px : float
        Standard deviation of the optics' point spread, pixels, of images without a blur of their
        own.
    blurs : ImageBlurs
        Of images that have one.
    levels : tuple of int
        GSDs one after the other, in units of the grid's: coarse to fine, the last is 1.
    rounds : int
        Most rounds of a level.
    albedo_sigma : float
        Standard deviation with which the relative albedo of each cell is drawn to its mean of 1:
        small where brightness varies by slopes, larger where there are bright and dark areas
        (Gaskell et al., §3.3).
    albedo_step_sigma : float
        Expected standard deviation of the albedo of a cell about the mean of the eight around it,
        with which single cells scatter by less than `albedo_sigma`: see :class:`AlbedoPrior`.
    convention : AlbedoConvention
        How the albedo is normalised and bounded.
    gradient_sigma : float
        Expected standard deviation of the relative change of an image's scale λ from the centre of
        the grid to its edge: errors of the photometric function, and of roughness that the grid
        does not resolve. Without it these errors would bend the surface.
    contrast_sigma : float
        Standard deviation of the error of an image's contrast, relative: relief that the grid does
        not resolve, light scattered in the camera, the photometric function. It tilts and bends the
        surface. It is not estimated, as the priors of slopes and albedo would favour less relief,
        but is in the sigmas.
    shift_sigma_px : float
        Standard deviation of the place of the grid in an image whose state is known exactly,
        pixels: errors of the camera.
    slope_sigma : float
        Expected standard deviation of the slope of a cell about that of the start surface.
    slope_loss_scale : float
        Departure from the slope of the start, in `slope_sigma`, at which this prior has half of its
        weight: sides of boulders that the start does not have are steep.
    independent_start : bool
        Whether the start owes nothing to these images, as the shape of another source: then how
        far the solved surface departs from it shows how wrong its slopes are, in place of
        `slope_sigma` in sigmas.
    slope_error_factor : float
        Factor on `slope_sigma` in sigmas where the departure is not known, and no heights are
        measured near: along a direction that images do not determine, slopes err alike in
        neighbouring cells, so that their errors do not average out.
    twist_sigma : float
        Expected standard deviation of ``(h00 − h01 − h10 + h11) / gsd`` of a cell's four corners,
        which its slopes do not contain. Where single points constrain a cell it is 0.12 at most.
    least_error : float
        Smallest error of brightness, relative: what the photometric function and the flat cells
        cannot express.
    least_brightness : float
        Brightness, relative to the mean of an image, below which the error of a pixel falls no
        further: slopes that the grid does not resolve change dark ground by as much as bright
        ground.
    loss_scale : float
        Residual, in its sigmas, beyond which a pixel is down-weighted: shadows of boulders smaller
        than a cell, cosmic rays, blooming.
    determined_sigma : float
        Largest sigma of a slope along a direction for which images determine it.
    least_elevation_deg : float
        Elevation of the Sun below which an image does not count in sigmas, or as determining a
        slope. Shadows hide one side of the relief in it, so that its errors are common to many
        cells.
    bend_sigma : float
        Standard deviation of the error of heights, of the bending of the surface around (m): edges
        and tops of boulders that the grid does not resolve.
    top_sigma : float
        The same of an error that the points of the top of a boulder have in common, where nothing
        but images shows it: the slopes of its sides are drawn to those of the start, or count as
        outliers. Of the bending beyond that of ordinary ground.
    measured_bend_sigma, measured_top_sigma : float
        Both where constraining heights with errors of their own measure the point, and the top.
    averaged_top_sigma : float
        That of a top of which only means over cells are measured.
    relief_albedo_sigma : float
        Standard deviation of the error of the albedo by relief that the grid does not resolve,
        relative: it darkens and brightens cells in all images alike.
    constraint_fraction : float
        Share of the constraining heights that count in a round, drawn anew each round (Gaskell et
        al., §4); 1 is all of them. In sigmas all count.
    seed : int
        Of these draws.
    stereo : bool
        Whether the displacement of ground in images by its height is in the equations; without it
        heights are those of slopes and constraints alone.
    settled_gsd, settled_albedo, settled_residual : float
        Robust standard deviation of the changes of heights in a round, GSDs, root mean square of
        those of albedo, and change of the residual of brightness (relative, median over images)
        from round to round, at which a level is converged. Where images are blurred differently
        and fit well, rounds go on until heights change by a tenth of that.
    other_functions : tuple of (PhotometricFunction, float), optional
        Functions that may be right instead, each with a weight: that of the squares of what it
        changes, in the variances of heights, slopes and albedo. None: they are not known.

    Raises
    ------
    SettingsError
        If a number is out of range.
    """

    function: PhotometricFunction = lunar_lambert
    psf_px: float = 0.0
    blurs: ImageBlurs = field(default_factory=ImageBlurs)
    levels: tuple[int, ...] = (4, 2, 1)
    rounds: int = 12
    albedo_sigma: float = 0.2
    albedo_step_sigma: float = 0.035
    convention: AlbedoConvention = field(default_factory=AlbedoConvention)
    gradient_sigma: float = 0.03
    contrast_sigma: float = 0.035
    shift_sigma_px: float = 0.05
    slope_sigma: float = 0.3
    slope_loss_scale: float = 1.0
    independent_start: bool = False
    slope_error_factor: float = 1.75
    twist_sigma: float = 0.35
    least_error: float = 0.01
    least_brightness: float = 1.0
    loss_scale: float = 3.0
    determined_sigma: float = 0.25
    least_elevation_deg: float = 20.0
    bend_sigma: float = 0.14
    top_sigma: float = 0.55
    measured_bend_sigma: float = 0.09
    measured_top_sigma: float = 0.12
    averaged_top_sigma: float = 0.15
    relief_albedo_sigma: float = 0.01
    constraint_fraction: float = 1.0
    seed: int = 1
    stereo: bool = True
    settled_gsd: float = 0.01
    settled_albedo: float = 0.003
    settled_residual: float = 0.003
    other_functions: tuple[tuple[PhotometricFunction, float], ...] | None = None

    @property
    def albedo_prior(self) -> AlbedoPrior:
        """What is expected of the albedo."""
        return AlbedoPrior(self.albedo_sigma, self.albedo_step_sigma)

    def blur_of(self, image: str) -> ImageBlur:
        """Return the blur of an image; it is the same where that shows ground in the shade."""
        return self.blurs.of(name_of_image(image) or image, self.psf_px)

    def for_images(self, images: Iterable[str]) -> Self:
        """Return them without the blur of other images than these, which does not matter then."""
        return replace(self, blurs=self.blurs.among(name_of_image(one) or one for one in images))

    def __post_init__(self) -> None:
        # It checks the point spread.
        ImageBlur(self.psf_px)
        for name in (
            "albedo_sigma", "albedo_step_sigma", "gradient_sigma", "contrast_sigma",
            "shift_sigma_px", "slope_sigma", "slope_loss_scale", "slope_error_factor",
            "twist_sigma", "least_error", "least_brightness", "loss_scale", "determined_sigma",
            "bend_sigma", "top_sigma", "measured_bend_sigma", "measured_top_sigma",
            "averaged_top_sigma", "relief_albedo_sigma", "settled_gsd", "settled_albedo",
            "settled_residual",
        ):  # fmt: skip
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SettingsError(f"must be positive, not {value}", name)
        if not 0.0 <= self.least_elevation_deg < 90.0:
            raise SettingsError(
                f"must be 0 to 90, not {self.least_elevation_deg}", "least_elevation_deg"
            )
        if not 0.0 < self.constraint_fraction <= 1.0:
            raise SettingsError(
                f"must be above 0, 1 at most, not {self.constraint_fraction}", "constraint_fraction"
            )
        if self.rounds < 1:
            raise SettingsError(f"must be at least 1, not {self.rounds}", "rounds")
        falling = all(a > b for a, b in zip(self.levels, self.levels[1:], strict=False))
        if not self.levels or self.levels[-1] != 1 or not falling:
            raise SettingsError(f"must fall to 1, not {self.levels}", "levels")
